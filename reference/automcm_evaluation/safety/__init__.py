"""Hazards under faults, with all safety mechanisms and without each of them.

Faults, ablations and hazards; section III-D of the paper.
Only ``sweeps`` imports it.
"""
