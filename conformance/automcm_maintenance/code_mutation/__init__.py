"""Mutants of the reference and the C++ station: does the suite find them?

For ``conform certify`` and docs/certificate.md.
Only maintenance imports it.
"""
