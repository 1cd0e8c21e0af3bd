"""Random walks over the graph, and the shortest exchange that fails.

Hypothesis, which was tried instead, found five of seven stations with two faults in two minutes,
and left 5 to 39 acts of a walk; the ways through the graph leave 2 to 11.

Used by ``conform explore``.
Only commands import this subpackage.
"""
