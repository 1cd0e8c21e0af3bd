"""The log format ``automcm.trace/1``: its records, a reader, a writer, and the JSON Schema.

Used by authors of log writers (docs/trace-format.md) and by all log tools. Any package may import
it; the reference imports only ``writer``.
"""
