"""The protocol's values: messages, inputs, effects, timers, parameters, rules.

It includes the compiled station (``station``), which computes the outcome of an input. Any package
may import it; the reference imports only the modules named in architecture.md.
"""
