"""System support for every package: files, folders, child processes, bad input.

It knows nothing of the protocol.
Any package may import it; it imports no other package.
"""
