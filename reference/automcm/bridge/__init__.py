"""Between a station and driving software elsewhere: rosbridge, Autoware, a router.

For integrators (docs/bridge.md).
The commands import it; the core and the service do not.
"""
