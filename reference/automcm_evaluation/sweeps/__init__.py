"""Runs experiments: the cells of a sweep in processes, and the pages and figures of the results.

For ``automcm experiment`` and the generator of docs/evaluation.md.
It imports the experiments; none of them imports it.
"""
