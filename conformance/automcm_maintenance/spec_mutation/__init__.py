"""Mutants of the specification: do the models notice?

For ``spec mutate`` and docs/mutation.md.
Only maintenance imports it.
"""
