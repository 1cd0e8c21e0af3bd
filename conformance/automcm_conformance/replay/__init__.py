"""Replays recorded behaviour: a counterexample, a log, or the graph of one station.

Used by ``trace replay`` and ``verify``.
Only commands and maintenance import this subpackage.
"""
