"""Mutants of the reference and of the C++ station, to test the suite.

For ``conform certify`` and docs/certificate.md.
Only maintenance imports it.
"""
