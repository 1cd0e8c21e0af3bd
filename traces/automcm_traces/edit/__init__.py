"""Derives smaller and comparable logs: slices, shrinking, differences.

Used by ``trace shrink`` and ``trace diff``.
The viewer and the commands import it.
"""
