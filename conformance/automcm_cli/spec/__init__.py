"""``automcm spec``: the models, checked one by one.

For protocol engineers running TLC.
Loaded by ``groups``; ``verify`` uses what it prints.
"""
