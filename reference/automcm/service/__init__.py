"""A running station: the core with a clock, a link, an application and a log.

For users who run a station in a simulation or as a process.
The bridge, the scenarios and the commands import it.
"""
