"""Checks one station's log against the specification, up to its end or the first divergence.

Used by the log tools and by the kit's scenario monitor. Every subpackage above imports it; it
imports only ``format``.
"""
