"""Random walks over the graph, and the shortest exchange that fails.

Used by ``conform explore``.
Only commands import this subpackage.
"""
