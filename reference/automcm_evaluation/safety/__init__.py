"""Hazards under faults, with all safety mechanisms and without each of them: section III-D."""
