"""Converts logs to ITF, MCAP, Mermaid and SVG, and counterexamples to logs.

Used for other tools, and for the pages of the models.
The viewer and the commands import it.
"""
