"""The paper's evaluation (section VI) as seeded sweeps, with further experiments.

For ``automcm experiment`` and docs/evaluation.md.
Only the commands and maintenance import it; it imports the reference.
"""
