"""The conformance kit: any station against the specification, with a verdict per rule.

For vendors, who write an adapter (docs/adapter.md).
Does not import the reference.
"""
