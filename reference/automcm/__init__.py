"""The reference implementation: how one does it."""
