"""Test vectors: for the trajectory kernels with exact ones of their own, and for signed messages.

For stations in other languages (docs/vectors.md).  Intentionally independent of the reference.
Only commands and maintenance import this subpackage.
"""
