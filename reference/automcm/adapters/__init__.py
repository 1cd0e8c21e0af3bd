"""The reference behind the kit's adapter protocol, and its map to the specification.

For the kit, which knows a station through its adapter alone, and for ``verify``.
Commands, evaluation and maintenance import it. ``spec_mapping`` alone knows the compiled station.
"""
