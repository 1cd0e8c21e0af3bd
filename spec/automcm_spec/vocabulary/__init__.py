"""The protocol's values: messages, inputs, effects, timers, parameters, rules.

Also the compiled station (``station``), which says what follows an input.
Anything may import it; the reference only what architecture.md names.
"""
