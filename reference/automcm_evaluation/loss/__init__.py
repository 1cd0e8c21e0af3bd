"""Success of exchanges under message loss: section VI-C of the paper.

Sessions, drives, and UDP sockets.
Only ``sweeps`` imports it.
"""
