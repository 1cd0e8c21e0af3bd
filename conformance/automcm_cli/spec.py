"""``automcm spec``: single models, and their counterexamples as inputs and what changed."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from typing import Any

from automcm_spec import models, simulate, tlc
from automcm_spec.oracle import STATE_FIELDS, canonical
from automcm_spec.rules import handler, line


def described(model: models.Model) -> str:
    """One line for ``automcm spec list``."""
    must = f"must break {model.property}" if model.expect == "violates" else "holds"
    return f"{model.cfg:28}{must:16}{model.profile:7}{model.why}"


def unknown(name: str, known: Sequence[str]) -> str:
    """That there is no such model, and which come nearest."""
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    return f"there is no model {name!r}" + (f"; nearest: {', '.join(near)}" if near else "")


def check(model: models.Model, say: Callable[[str], None]) -> models.Verdict:
    """Run TLC on one model, saying how far it is."""

    def progress(p: tlc.Progress) -> None:
        say(f"{model.cfg}: depth {p.depth}, {p.distinct_states:,} states, {p.queue:,} to go")

    say(model.cfg)
    return models.check(model, on_progress=progress)


def as_dict(verdict: models.Verdict) -> dict[str, Any]:
    """A model and its outcome, as in the JSON of ``automcm verify``."""
    result = verdict.result
    return {
        "name": verdict.model.cfg,
        "expect": verdict.model.expect,
        "outcome": verdict.outcome,
        "property": verdict.property,
        "distinct_states": result.distinct_states if result else None,
        "states": result.states if result else None,
        "depth": result.depth if result else None,
        "length": len(verdict.trace) or None,
        "seconds": round(result.seconds, 1) if result else None,
        "problem": verdict.problem,
    }


def shown(verdict: models.Verdict) -> str:
    """The outcome in words, with the counterexample."""
    model, result = verdict.model, verdict.result
    if result is None:
        return f"{model.cfg}: {verdict.problem}"
    expected = "as expected" if verdict.ok else f"NOT as expected: {verdict.problem}"
    found = f"{result.distinct_states:,} distinct states, {result.seconds:.1f} s"
    if verdict.outcome == "holds":
        return f"{model.cfg}: every property holds; {found}; {expected}"
    head = f"{model.cfg}: {verdict.property} is violated; {found}; {expected}"
    return "\n".join([head, *_steps(verdict)])


def _steps(verdict: models.Verdict) -> list[str]:
    """Each step: the station, its input, the rule and line that decided, the fields changed."""
    lines = []
    for before, after in zip(verdict.trace, verdict.trace[1:], strict=False):
        last: Any = after.values["last"]
        given, who, rule = simulate.input_(last["input"]), last["station"], last["rule"]
        where = f"{handler(given)}, Station.tla:{line(rule, given)}"
        lines.append(f"{after.index - 1:3}. station {who}: {canonical(given)}  [{rule}: {where}]")
        lines.append(f"     {_changed(before.values['st'], after.values['st'], who)}")
    return lines


def _changed(before: Any, after: Any, who: int) -> str:
    old, new = simulate.state(before[who - 1]), simulate.state(after[who - 1])
    changes = [
        f"{name} {canonical(a)} → {canonical(b)}"
        for name, a, b in zip(STATE_FIELDS, old, new, strict=True)
        if a != b
    ]
    return ", ".join(changes) or "nothing changes"


def exit_code(verdicts: Sequence[models.Verdict]) -> int:
    """0 as expected, 1 not, 3 if TLC gave no verdict."""
    if any(verdict.error for verdict in verdicts):
        return 3
    return 0 if all(verdict.ok for verdict in verdicts) else 1
