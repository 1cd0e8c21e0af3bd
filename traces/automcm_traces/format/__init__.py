"""The log format ``automcm.trace/1``: its lines, a reader, a writer, the schema.

For authors of log writers (docs/trace-format.md) and for all log tools.
Anything may import it; the reference imports ``writer`` alone.
"""
