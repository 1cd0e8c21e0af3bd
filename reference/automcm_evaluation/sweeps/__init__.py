"""Runs experiments: the cells of a sweep in processes, and the pages and figures of the results."""
