"""Runs an experiment's cells, and writes what they say.

For ``automcm experiment`` and the page docs/evaluation.md.
Imports the experiments, by name; none of them imports it.
"""
