"""The verdict on a log: what diverges, why, and what was allowed instead.

For ``trace explain``, ``lint``, ``coverage`` and ``show``.
edit, export and viewer import it.
"""
