"""``spec prove``: the invariant of Inductive.tla is inductive, by z3."""
