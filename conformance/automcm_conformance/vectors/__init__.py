"""Test vectors for the trajectory kernels, with exact kernels of their own.

For stations in other languages (docs/vectors.md).
Independent of the reference on purpose. Only commands and maintenance import it.
"""
