"""``automcm spec simulate``: the result of random behaviours of a model, as text."""

from __future__ import annotations

from automcm_cli.spec.model_output import steps
from automcm_spec.model_checking.random_walks import Walks

_ENDED = {
    "time": "ended by the time limit",
    "number": "as many as requested",
    "violation": "ended by a violation",
}


def shown(walks: Walks) -> str:
    """The outcome, the counterexample if there is one, and the number of steps of each rule."""
    found = f"{walks.behaviours:,} behaviours, {walks.steps:,} steps ({_ENDED[walks.ended]})"
    head = f"{walks.model.name}, seed {walks.seed}, depth {walks.depth}: {found}"
    return "\n".join([head, _verdict(walks), *steps(walks.trace), *_rules(walks)])


def _verdict(walks: Walks) -> str:
    breaks = walks.model.breaks
    if walks.property is not None:
        expected = "as expected" if walks.property == breaks else "NOT as expected: it must hold"
        return f"{walks.property} is violated; {expected}"
    if breaks:
        return f"cannot tell: {breaks} must be violated, but these behaviours do not violate it"
    return "no property is violated in these behaviours (this proves nothing about others)"


def _rules(walks: Walks) -> list[str]:
    counts = [f"{rule} {n:,}" for rule, n in sorted(walks.rules.items())]
    lines = ["Steps decided by each rule:"]
    for at in range(0, len(counts), 6):
        lines.append("  " + "".join(f"{count:15}" for count in counts[at : at + 6]).rstrip())
    lines.append("never: " + (" ".join(walks.never) or "none"))
    lines.append("(a CAM, or an input without effect, is not a step of a model)")
    return lines
