"""``automcm trace``: commands that show, check, compare and convert logs.

For anyone with a log.
Loaded by ``groups`` when one of its commands is used.
"""
