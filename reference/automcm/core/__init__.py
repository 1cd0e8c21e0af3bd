"""One station without input or output: its state, its phases, its rules.

For reviewers who assess its safety.
``service`` and ``adapters`` import it; it imports only messages and parameters.
"""
