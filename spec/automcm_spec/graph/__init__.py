"""The graph of one station: every state, every input, and the required outcome.

Used by the kit, and to compare the reference with the specification. The kit, the commands and
maintenance import it; the log tools do not.
"""
