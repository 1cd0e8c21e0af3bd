"""Test vectors for the trajectory kernels, with exact kernels of their own.

For stations in other languages (docs/vectors.md).  Intentionally independent of the reference.
Only commands and maintenance import this subpackage.
"""
