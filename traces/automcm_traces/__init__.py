"""What happened: logs of stations, checked against the specification.

For anyone with a log.
Subpackages, from the bottom: format, checker, system, explain, edit, export, viewer.
"""
