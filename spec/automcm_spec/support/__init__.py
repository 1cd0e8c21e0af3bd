"""Files, folders, child processes, bad input: what every package needs of the system.

Knows nothing of the protocol.
Anything may import it; it imports nothing of ours.
"""
