"""``automcm spec``: commands that check single models.

For protocol engineers who run TLC.
Loaded by ``groups``; ``verify`` uses its texts.
"""
