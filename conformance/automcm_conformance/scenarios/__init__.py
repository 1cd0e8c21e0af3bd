"""Scenarios with several stations, each behind a process, on a scripted radio.

For the cases that one station alone cannot show.
The suite and ``replay`` import it.
"""
