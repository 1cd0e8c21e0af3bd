"""Random walks over the graph, and the shortest exchange that fails.

For ``conform explore``.
Only commands import it.
"""
