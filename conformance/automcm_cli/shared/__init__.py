"""What commands share: options, exit codes in words, JSON, progress.

For the modules of commands.
Imports none of the other subpackages.
"""
