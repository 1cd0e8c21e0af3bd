"""Arrival times with and without coordination: section VI-B of the paper.

On the simulated road and in SUMO.
Only ``sweeps`` and ``loss`` import it.
"""
