"""Does the receiver arrive earlier with coordination? Section VI-B of the paper.

On a simulated road, and on SUMO's.
Only ``runs`` and ``loss`` import it.
"""
