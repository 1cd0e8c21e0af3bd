"""Log tools: they check the logs of stations against the specification.

For anyone with a log. Subpackages, from the bottom: format, checker, system, explain, edit, export,
viewer.
"""
