"""The reference implementation of a station, with links, scenarios and a bridge.

For engineers who want to run a station, or to read how one is written.
``core`` is the station itself; it does no input or output. See docs/reference.md.
"""
