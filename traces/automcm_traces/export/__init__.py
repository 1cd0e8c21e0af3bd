"""Logs as ITF, MCAP, Mermaid and SVG, and counterexamples as logs.

For other tools, and for the pages of the models.
The viewer and the commands import it.
"""
