"""The reference implementation of a station, and what drives it.

For engineers who read how a station is written, or run one.
The station itself is ``core``; it does no input or output. See docs/reference.md.
"""
