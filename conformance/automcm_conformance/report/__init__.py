"""The report of a run: JSON, JUnit, HTML, and terminal.

Used by vendors and their CI.
Only commands import this subpackage.
"""
