"""The verdict on a log: where it diverges, why, and what was allowed instead.

Used by ``trace explain``, ``lint``, ``coverage`` and ``show``.
The subpackages edit, export and viewer import it.
"""
