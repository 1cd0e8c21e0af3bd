"""Bandwidth of the messages: section VI-A of the paper.

Bytes of sessions, and the load of a radio channel.
Only ``sweeps`` imports it.
"""
