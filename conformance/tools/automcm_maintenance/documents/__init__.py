"""Generates pages, pictures and schemas, and finds stale ones."""
