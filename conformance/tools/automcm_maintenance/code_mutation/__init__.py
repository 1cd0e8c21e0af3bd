"""Mutants of the reference and of the C++ station, to test the suite.

For ``conform certify`` and conformance/certificate.json.
Only maintenance imports it.
"""
