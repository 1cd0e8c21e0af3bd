"""The paper's evaluation (section VI) as seeded sweeps, and further experiments."""
