"""What an experiment is: settings, cells that run apart, claims, intervals, figures.

For the five experiments.
They import it; it imports none of them.
"""
