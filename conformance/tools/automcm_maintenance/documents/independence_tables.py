"""The tables of docs/verification.md: the interface between sessions, uses of ids and numbers."""

from __future__ import annotations

from typing import Any

from automcm_maintenance.compilation import data_independence, independence, sany
from automcm_spec.model_checking import models

PREFIX = "interface_"
"""The must-fail models that leave out a member of the interface."""


def interface() -> str:
    """For each member of the interface, two states that differ only in other sessions, and answer
    the same input differently.

    Raises the exceptions of ``sany.export`` and ``models.load``; ValueError if no two are found.
    """
    xml = sany.export(independence.PLAN.module)
    rows = ["| member | state | input | answer | the same session alone | answer |"]
    rows.append("|---|---|---|---|---|---|")
    for model in models.load():
        if not model.cfg.startswith(PREFIX) or model.property is None:
            continue
        replaced = models.replaced_in(model.config)
        module = independence.load(xml=xml, substitutions=replaced)
        station = independence.OpenLimits.of(model.config).station(module)
        found = independence.first_violation(station, model.property)
        if found is None:
            raise ValueError(f"{model.cfg}: every session answers as if it were alone")
        alone = next(
            alone
            for x in station.of(found.state, found.input)
            if (alone := station.alone(found.state, x)) and not station.own(*_both(found), x)
        )
        answer = station.step(station.me, alone, found.input)
        cells = [*replaced, _state(station, found.state), _input(found.input)]
        cells += [_answer(found.outcome), _state(station, alone), _answer(answer)]
        rows.append("| " + " | ".join(f"`{c}`" if c in replaced else c for c in cells) + " |")
    return "\n".join(rows)


def _both(found: independence.Violation) -> tuple[Any, Any, Any]:
    return found.state, found.outcome, found.input


def _state(station: Any, st: Any) -> str:
    """The fields that differ from the initial state."""
    words = []
    for name, value, first in zip(st._fields, st, station.initial, strict=True):
        if value == first or name == "role":
            continue
        words.append(_value(value) if name == "phase" else f"{name} {_value(value)}")
    return ", ".join(words) or "initial"


def _value(value: Any) -> str:
    if isinstance(value, frozenset):
        return "{" + ", ".join(sorted(map(_value, value))) + "}"
    if hasattr(value, "type"):  # an entry of the outbox
        return f"{value.type} in {_value(value.session)}"
    if isinstance(value, tuple):
        return ".".join(map(str, value))
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def _input(i: Any) -> str:
    if i.kind == "receive":
        return f"{i.message.type} in {_value(i.message.session)}"
    return f"command {i.name}"


def _answer(r: Any) -> str:
    sent = [f"{m.type}" + f" ({m.reason})" * (m.reason != "none") for m in r.out]
    return f"{', '.join(sorted(sent)) or 'nothing'} ({r.rule})"


def uses() -> str:
    """What the operators of Station.tla do with ids and session numbers.

    Raises the exceptions of ``sany.export``; sany.NotCompiled if one does something else.
    """
    found = data_independence.uses(sany.export(data_independence.MODULE))
    rows = ["| | " + " | ".join(data_independence.USES) + " |", "|---" * 5 + "|"]
    for kind, title in (("id", "ids"), ("number", "session numbers")):
        cells = [title]
        for use in data_independence.USES:
            names = found[kind, use]
            few = ", ".join(f"`{name}`" for name in names)
            cells.append(few if len(names) <= 2 else f"{len(names)} operators")
        rows.append("| " + " | ".join(cell or "none" for cell in cells) + " |")
    return "\n".join(rows)
