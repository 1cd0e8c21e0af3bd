"""Smaller and comparable logs: slices, shrinking, differences.

For ``trace shrink``, ``diff`` and ``slice``.
The viewer and the commands import it.
"""
