"""A station at work: the core with timers, a link, an application and a log.

For whoever runs a station, in a simulation or as a process.
The bridge, the scenarios and the commands import it.
"""
