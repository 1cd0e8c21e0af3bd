"""``automcm conform``: tests of a station in any language against the specification.

For vendors.
Loaded by ``groups`` when one of its commands is used.
"""
