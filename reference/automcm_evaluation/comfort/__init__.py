"""Speed and braking of each vehicle: section VI-B and figure 6 of the paper.

Drives with and without faults.
Only ``sweeps`` imports it.
"""
