"""Coverage of the specification: how often each condition of Station.tla was true and false.

It counts the conditions that a step, or the marks of a CAM, may evaluate. Conditions that only the
type invariant or the alphabet of the models evaluates do not count.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple

from automcm_spec.vocabulary import rules, station
from automcm_spec.vocabulary.conditions import Condition
from automcm_spec.vocabulary.tla_names import snake

ROOTS = ("step", "marks")
BOTH = (False, True)
Mark = Literal["", "both", "true", "false", "part", "met", "never"]


class Reached(NamedTuple):
    """The entries of CONDITIONS that the roots may evaluate, in the order of the specification.

    A LET definition may occur several times in the compiled source. Of occurrences with equal text
    at the same line of an operator, the first represents all.
    """

    conditions: tuple[Condition, ...]
    rules: tuple[Condition, ...]
    """The places where a rule is named as deciding."""
    first: dict[Condition, Condition]
    last_arms: frozenset[Condition]
    """The last arms of CASE expressions without OTHER. They must be true, otherwise TLC stops."""

    def values(self, condition: Condition) -> tuple[bool, ...]:
        """The possible values of a condition."""
        return (True,) if condition in self.last_arms else BOTH


@cache
def reached() -> Reached:
    """The reachable conditions, from the source of the compiled station."""
    tree = ast.parse(Path(str(station.__file__)).read_text(encoding="utf-8"))
    methods = {
        node.name: node
        for body in tree.body
        if isinstance(body, ast.ClassDef) and body.name == station.Station.__name__
        for node in body.body
        if isinstance(node, ast.FunctionDef)
    }
    called, following = set[str](), list(ROOTS)
    while following:
        name = following.pop()
        if name in methods and name not in called:
            called.add(name)
            following += [
                node.attr
                for node in ast.walk(methods[name])
                if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "self"
            ]
    own = [c for c in station.CONDITIONS if snake(c.operator) in called]
    last = {name: set(_last_arms(methods[name])) for name in called}
    places: dict[Condition, Condition] = {}
    first = {c: places.setdefault(c._replace(node=0), c) for c in own}
    return Reached(
        tuple(c for c in places.values() if c.kind != "rule"),
        tuple(c for c in places.values() if c.kind == "rule"),
        first,
        frozenset(c for c in own if c.node in last[snake(c.operator)]),
    )


def _last_arms(method: ast.FunctionDef) -> Iterator[int]:
    """The tests followed only by NoArm, as indices in the order of ast.walk."""
    place = {id(node): n for n, node in enumerate(ast.walk(method))}
    for node in ast.walk(method):
        body = getattr(node, "body", [])
        for test, after in pairwise(body if isinstance(body, list) else []):
            if isinstance(test, ast.If) and isinstance(after, ast.Raise):
                yield place[id(test.test)]


@dataclass(slots=True)
class ConditionCoverage:
    """Counts the conditions evaluated by a recording station: ``recording(station, coverage.meet)``
    (automcm_spec.vocabulary.conditions)."""

    ways: Counter[tuple[Condition, bool]] = field(default_factory=Counter)
    """How often a condition had a value; for a rule, how often it decided there."""
    times: int = 1
    """How many evaluations the current one counts for."""

    def meet(self, condition: Condition, value: bool, _: Callable[[], object]) -> bool:
        """Count an evaluation (a Hook of automcm_spec.vocabulary.conditions)."""
        self.ways[reached().first.get(condition, condition), value] += self.times
        return value

    def missing(self, condition: Condition) -> list[bool]:
        """The possible values that a condition did not have."""
        return [value for value in reached().values(condition) if not self.ways[condition, value]]

    def both_ways(self) -> int:
        """The number of conditions that had all their possible values."""
        return sum(not self.missing(c) for c in reached().conditions)

    def as_list(self) -> list[dict[str, str | int | None]]:
        """Each condition with the number of times it was true and false; null for an impossible
        value."""
        found: list[dict[str, str | int | None]] = []
        for c in reached().conditions:
            can_be = reached().values(c)
            times = {str(v).lower(): self.ways[c, v] if v in can_be else None for v in BOTH}
            found.append({"operator": c.operator, "line": c.line, "text": c.text, **times})
        return found


def lacking(coverage: ConditionCoverage) -> list[str]:
    """A line for each condition that was ``never`` evaluated or had only one value, and one line
    for an operator of which none was evaluated."""
    lines = []
    for operator, own in _by("operator", reached().conditions).items():
        if len(own) > 1 and _mark(coverage, own) == "never":
            lines.append(f"never {operator}:{own[0].line} ({len(own)} conditions)")
            continue
        for c in own:
            if coverage.missing(c):
                lines.append(f"{_mark(coverage, [c]):<5} {operator}:{c.line} {c.text}")
    return lines


@dataclass(frozen=True, slots=True)
class SpecLine:
    """A line of Station.tla with its coverage.

    ``mark`` is ``both``: every condition had all its possible values; ``true``, ``false``: its
    condition had only that value; ``part``: some conditions lack a value; ``never``: not reached. A
    line without a condition that names a rule has ``met`` or ``never``. All other lines have none.
    """

    number: int
    text: str
    mark: Mark
    conditions: tuple[Condition, ...]
    rules: tuple[Condition, ...]


def by_operator(coverage: ConditionCoverage) -> dict[str, list[SpecLine]]:
    """The text of Station.tla, by operator; the part before the first has an empty name."""
    conditions, deciding = _by("line", reached().conditions), _by("line", reached().rules)
    return {
        name: [
            _line(coverage, number, text, conditions.get(number, []), deciding.get(number, []))
            for number, text in enumerate(body.split("\n"), first)
        ]
        for name, (first, body) in rules.operators().items()
    }


def _line(
    coverage: ConditionCoverage, number: int, text: str, own: list[Condition], by: list[Condition]
) -> SpecLine:
    mark: Mark = ""
    if own:
        mark = _mark(coverage, own)
    elif by:
        mark = "met" if any(coverage.ways[c, True] for c in by) else "never"
    if mark in ("true", "false") and f"~{own[0].text}" in text:
        mark = "part"  # the line negates the condition
    return SpecLine(number, text, mark, tuple(own), tuple(by))


def annotated(coverage: ConditionCoverage) -> list[str]:
    """The operators of Station.tla that a step evaluates, each line with its mark; below a line
    marked ``part``, the conditions that lack a value."""
    operators = {c.operator for c in (*reached().conditions, *reached().rules)}
    lines = []
    for name, body in by_operator(coverage).items():
        if name not in operators:
            continue
        for line in _without_what_follows(body):
            lines.append(f"{line.mark:>5} {line.number:>4} {line.text}".rstrip())
            if line.mark == "part":
                lacks = [c for c in line.conditions if coverage.missing(c)]
                lines += [f"{_mark(coverage, [c]):>17}: {c.text}" for c in lacks]
        lines.append("")
    return lines[:-1]


def _by(field: str, conditions: Iterable[Condition]) -> dict[Any, list[Condition]]:
    """The conditions by the value of a field."""
    found: dict[Any, list[Condition]] = {}
    for c in conditions:
        found.setdefault(getattr(c, field), []).append(c)
    return found


def _without_what_follows(body: list[SpecLine]) -> list[SpecLine]:
    """The lines of an operator, without the comment before the next operator."""
    last = len(body)
    while not body[last - 1].text or body[last - 1].text.startswith(("(*", "\\*", "===")):
        last -= 1
    return body[:last]


def _mark(coverage: ConditionCoverage, conditions: Sequence[Condition]) -> Mark:
    """The coverage of some conditions as one word."""
    met = [[value for value in BOTH if coverage.ways[c, value]] for c in conditions]
    if not any(met):
        return "never"
    if not any(map(coverage.missing, conditions)):
        return "both"
    if len(conditions) > 1:
        return "part"
    return "true" if met[0][0] else "false"
