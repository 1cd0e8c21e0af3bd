"""A run's report: JSON, JUnit, HTML, terminal, and as pytest cases.

For vendors and their CI.
Only commands and pytest import it.
"""
