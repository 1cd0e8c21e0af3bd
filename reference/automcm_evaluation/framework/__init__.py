"""The framework of the experiments: settings, independent cells, claims, intervals, figures.

For all experiments.
They import it; it imports none of them.
"""
