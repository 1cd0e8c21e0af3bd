"""Mutants of the specification, to test the models.

For ``spec mutate`` and spec/mutation/results.json.
Only maintenance imports it.
"""
