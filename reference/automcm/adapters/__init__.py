"""The reference behind the kit's adapter protocol, and its mapping to the specification.

For the kit, which reaches a station only through its adapter, and for ``verify``.
Commands, evaluation and maintenance import it. Only ``spec_mapping`` uses the compiled station.
"""
