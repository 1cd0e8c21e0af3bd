"""Shared by commands: options, exit codes as text, JSON, progress.

For the modules that define commands.
Imports none of the other subpackages.
"""
