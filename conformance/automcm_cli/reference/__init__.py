"""Commands that run the reference: station, adapter, drive, demo, simulate, experiment, vectors.

For engineers who want to see the protocol run.
Loaded by ``main`` and ``groups``.
"""
