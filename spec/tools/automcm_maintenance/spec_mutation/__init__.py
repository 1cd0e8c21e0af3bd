"""Mutants of the specification, to test the models.

For ``spec mutate`` and docs/mutation.md.
Only maintenance imports it.
"""
