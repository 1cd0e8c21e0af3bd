"""Which rules the comparison really checks: each is taken away, and must be missed."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from automcm_conformance.compare import Adapter, walk
from automcm_spec.oracle import Oracle
from automcm_spec.rules import NO_GRAPH, RULES


@dataclass(slots=True)
class Coverage:
    """``covered``: rules whose absence the walk noticed, with the rule it then named."""

    covered: dict[str, str] = field(default_factory=dict)
    uncovered: list[str] = field(default_factory=list)
    by_test: dict[str, str] = field(default_factory=lambda: dict(NO_GRAPH))


Ablated = Callable[[str], Adapter]
"""An implementation without one rule."""


def rules(
    oracle: Oracle,
    ablated: Ablated,
    on_rule: Callable[[str], None] | None = None,
    *,
    wanted: Iterable[str] = RULES,
) -> Coverage:
    """Take each rule away and walk until a difference shows.  Rules that no graph can show
    are listed with the test that shows them."""
    result = Coverage()
    for rule in wanted:
        if rule in NO_GRAPH:
            continue
        if on_rule is not None:
            on_rule(rule)
        found = walk(oracle, ablated(rule), stop_at_first=True).divergences
        if found:
            result.covered[rule] = found[0].rule
        else:
            result.uncovered.append(rule)
    return result
