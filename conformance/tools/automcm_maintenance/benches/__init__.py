"""Benchmarks: each prints ratios to a baseline of the same run.

For ``automcm bench`` and ``spec bench``.
Only maintenance imports it.
"""
