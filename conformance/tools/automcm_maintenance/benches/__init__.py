"""Benchmarks: each prints ratios to a baseline of the same run.

For ``automcm bench``.
Only maintenance imports it.
"""
