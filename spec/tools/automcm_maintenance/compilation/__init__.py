"""Compiles Station.tla to ``vocabulary/station.py``, which needs no Java."""
