"""What do the safety mechanisms prevent? Each is taken away in turn.

Faults, ablations, hazards; section III-D of the paper.
Only ``runs`` imports it.
"""
