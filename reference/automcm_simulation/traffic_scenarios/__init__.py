"""The scenarios of stations in traffic, their catalogue, and how one is run.

Each is an application of automcm.applications on roads of ``traffic/networks``.
Only the commands import it.
"""
