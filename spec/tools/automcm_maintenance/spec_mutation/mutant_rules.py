"""The replacements that make mutants, and the exceptions with their reasons: mutant_rules.toml."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Literal

MODULES = ("Station", "System")
"""The modules that are mutated by default."""

_TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
KINDS: dict[str, str] = _TABLES["kinds"]
"""What a mutant of each kind changes."""
How = Literal["property", "probe", "graph", "evaluation", "timeout", "counts"]
HOW: dict[How, str] = {
    "property": "a property that must hold is violated",
    "probe": "a probe reaches a situation that it did not reach before, or no longer reaches one",
    "graph": "an answer of one station differs from the oracle, and so from the reference",
    "evaluation": "TLC cannot evaluate the mutant",
    "timeout": "TLC exceeds three times the time without the mutant, or its memory",
    "counts": "only the recorded numbers of states or steps differ",
}
"""What a mutant may change.  Only the first kills it; the others, the most informative first, are
comparisons with the specification without the mutant."""

NOT_MUTATED: dict[str, str] = _TABLES["not_mutated"]
"""Definitions that are not mutated, and the reasons.  For properties see PROPERTIES_FROM."""
PROPERTIES_FROM = "Helpers of the properties"
"""A module is not mutated after the heading with these words, so that no property is weakened."""

HISTORY = {"excused", "received", "last"}
"""Variables whose next value is not mutated, because only properties read them."""

UNSEEN_FIELDS = {"rule", "again"}
"""Fields of an effect that are not mutated: no model reads them (the oracle's graph has them)."""

UNREAD_ZERO = "Cmd"
"""A zero as this operator's argument fills an unused field of a command."""

UNINDEXED = {"t", "timer", "of"}
"""Tuples of different types, whose index is not mutated: TLC could not evaluate the mutant.  For
the same reason, the conditions of a CASE without OTHER are not mutated; its actions are."""

NEIGHBOURS: dict[str, str] = _TABLES["neighbours"]
"""Constants and plausible replacements of the same kind."""
COMMANDS: dict[str, str] = _TABLES["commands"]
"""Replacements for the names of commands."""
