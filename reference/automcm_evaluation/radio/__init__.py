"""The radio: its table beside ns-3, and the paper's loss figures over it."""
