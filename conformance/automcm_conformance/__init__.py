"""The conformance kit: a station against the oracle, with a verdict per rule."""
