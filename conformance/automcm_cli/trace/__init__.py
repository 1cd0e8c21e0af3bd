"""``automcm trace``: what a log means, and where it diverges.

For anyone with a log.
Loaded by ``groups`` when one of its commands is wanted.
"""
