"""The graph of one station: each state, each input, and what must follow.

For the kit, and for the comparison of the reference with the specification.
The kit, the commands and maintenance import it; the log tools do not.
"""
