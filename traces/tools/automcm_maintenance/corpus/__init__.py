"""Builds traces/corpus: logs, each with its verdict.

For ``make generate``.
Only maintenance imports it.
"""
