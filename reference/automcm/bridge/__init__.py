"""The bridge between a station and driving software in another process: rosbridge and Autoware.

For integrators (docs/bridge.md).
The commands import it; the core and the service do not.
"""
