"""Scenarios with several stations, each behind a process, on a scripted radio.

For cases that need more than one station.
``suite`` and ``replay`` import this subpackage.
"""
