"""Follows one station's log on the specification, to its end or to where it diverges.

For the log tools, and for the kit's monitor of a scenario.
Everything above imports it; it imports ``format`` alone.
"""
