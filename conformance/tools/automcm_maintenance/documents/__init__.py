"""Generates the committed pages, pictures and schemas, and finds stale ones.

For ``make generate`` and ``make verify``.
Only maintenance imports it.
"""
