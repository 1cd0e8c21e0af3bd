"""The report of a run: JSON, JUnit, HTML, terminal, and pytest cases.

Used by vendors and their CI.
Only commands and pytest import this subpackage.
"""
