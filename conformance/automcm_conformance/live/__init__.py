"""A station that runs by its own clock, over UDP.

For ``conform live``.
Only commands import it.
"""
