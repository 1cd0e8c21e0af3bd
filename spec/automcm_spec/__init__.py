"""The specification: its TLA+ modules, its models, and the driver that runs TLC on them."""
