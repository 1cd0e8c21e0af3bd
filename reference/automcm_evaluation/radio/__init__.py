"""The radio: its table beside ns-3, and the paper's loss figures over it.

Traffic of CAMs on a road, what arrives of it, drives and sessions.
Only ``sweeps`` imports it.
"""
