"""Bytes of sessions, and the load of a radio channel: section VI-A of the paper."""
