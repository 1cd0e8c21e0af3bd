"""Proof that the invariant of Inductive.tla is inductive, by z3.

For ``spec prove``; needs the packages of the extra ``prove``.
Only maintenance imports it.
"""
