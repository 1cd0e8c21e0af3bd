"""Compiles Station.tla to ``vocabulary/station.py``.

For ``make generate`` and for the check that the committed file is up to date.
Only maintenance imports it.
"""
