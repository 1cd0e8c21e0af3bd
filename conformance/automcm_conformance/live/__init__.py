"""A station that runs by its own clock, over UDP.

Used by ``conform live``.
Only commands import this subpackage.
"""
