"""``make verify``: its stages and its screen.

For engineers who want to see every claim checked.
Only ``repository_commands`` imports it.
"""
