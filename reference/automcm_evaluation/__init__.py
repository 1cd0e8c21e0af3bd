"""The paper's evaluation (section VI) as seeded sweeps, and what the paper does not have.

For ``automcm experiment`` and docs/evaluation.md.
Only the commands and maintenance import it; it imports the reference.
"""
