"""The cases: which there are, how each is driven, and the verdict on each.

For ``conform run`` and ``conform list``.
explore, live and report import it.
"""
