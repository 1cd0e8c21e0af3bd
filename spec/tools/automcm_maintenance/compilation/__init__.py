"""Compiles Station.tla to ``vocabulary/station.py``.

Used by ``make generate``, and to check that the committed file is up to date. Only maintenance
imports it.
"""
