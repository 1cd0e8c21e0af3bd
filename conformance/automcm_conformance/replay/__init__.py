"""A recorded behaviour again: a counterexample, a log, or two graphs compared.

For ``trace replay`` and ``verify``.
Only commands and maintenance import it.
"""
