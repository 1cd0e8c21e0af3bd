"""``make verify``: its stages and its screen.

For engineers who want to check every claim.
Only ``repository_commands`` imports it.
"""
