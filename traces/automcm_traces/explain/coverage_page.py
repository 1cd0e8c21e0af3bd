"""Coverage as a page: the text of Station.tla, each line green, red or neutral."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from automcm_spec.support.templates import environment
from automcm_spec.vocabulary.condition_coverage import (
    BOTH,
    ConditionCoverage,
    Mark,
    SpecLine,
    by_operator,
    reached,
)
from automcm_spec.vocabulary.rules import RULES
from automcm_traces.explain.coverage import LogCoverage, problems, shares

Colour = Literal["taken", "part", "missed", "neutral"]
COLOURS: Mapping[Mark, Colour] = {
    "both": "taken",
    "met": "taken",
    "true": "part",
    "false": "part",
    "part": "part",
    "never": "missed",
    "": "neutral",
}


class Shown(NamedTuple):
    """A line of the page."""

    number: int
    text: str
    colour: Colour
    notes: Sequence[str]
    """How often each condition was true and false."""
    rules: Mapping[str, int]
    """How often each rule decided there."""


def page(coverage: LogCoverage) -> str:
    """The page, which is one file and needs no network."""
    conditions = coverage.conditions
    parts = {
        name: [_shown(conditions, line) for line in body]
        for name, body in by_operator(conditions).items()
    }
    templates = environment(Path(__file__).parent, autoescape=True)
    template = templates.get_template("coverage.html.j2")
    return template.render(
        coverage=coverage,
        problems=problems(coverage),
        shares=list(shares(coverage)),
        parts=parts,
        counts={name: _counts(lines) for name, lines in parts.items()},
        total=_counts([line for lines in parts.values() for line in lines]),
        meaning=RULES,
    )


def _shown(coverage: ConditionCoverage, line: SpecLine) -> Shown:
    decided: Counter[str] = Counter()
    for c in line.rules:
        decided[c.text] += coverage.ways[c, True]
    notes = []
    for c in line.conditions:
        can_be = reached().values(c)
        times = [f"{str(v).lower()} {coverage.ways[c, v]:,}" for v in reversed(BOTH) if v in can_be]
        notes.append(f"{c.text}: {', '.join(times)}")
    return Shown(line.number, line.text, COLOURS[line.mark], notes, decided)


def _counts(lines: Sequence[Shown]) -> dict[str, int]:
    colours = [line.colour for line in lines]
    return {colour: colours.count(colour) for colour in ("taken", "part", "missed")}
