"""The application layer of the paper: lane change, ramp merge, and who occupies which lane.

An application decides and drives; the service does the rest (docs/adding-a-scenario.md).
"""
