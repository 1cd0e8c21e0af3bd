"""The framework of the experiments: settings, independent cells, claims, intervals, figures.

For the five experiments.
They import it; it imports none of them.
"""
