"""How many bytes do the messages take? Section VI-A of the paper.

Counted in sessions, and on a radio channel.
Only ``runs`` imports it.
"""
