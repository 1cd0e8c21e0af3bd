"""Commands that run the reference: station, keys, drive, demo, simulate, experiment and others.

For engineers who want to see the protocol run.
Loaded by ``main`` and ``groups``.
"""
