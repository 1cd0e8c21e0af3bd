"""One station without input or output: its state, its phases, its rules.

For the reader who decides whether to trust a car with it.
``service`` and ``adapters`` import it; it imports messages and parameters alone.
"""
