"""State diagrams of both roles: the graph of one station, seen as (role, phase) alone."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

from automcm_spec.oracle import Json, Oracle
from automcm_spec.rules import RULES

ROLES = ("prescriber", "receiver")
_PHASE, _ROLE, _DECIDING = 0, 1, 7


@dataclass(frozen=True, slots=True)
class Edge:
    """A step from one phase of a role to another, by an event, under a rule."""

    role: str
    source: str
    target: str
    event: str
    rule: str
    told: str
    """What the application is told; empty for nothing."""


def event(i: Json) -> str:
    """An input in a word or two: a message by its type, a command by its name, a timer."""
    if i[0] == "receive":
        message = i[1]
        if message[0] == "Ack":
            return f"Ack of {message[8][0]}"
        if message[0] == "Acceptance":
            return f"Acceptance({'accepted' if message[6] else 'refused'})"
        return str(message[0])
    if i[0] == "expire":
        name = i[1][0]
        about = f"({i[1][1][0]})" if name in ("giveup", "resend") else ""
        return f"{name}{about} expires"
    return str(i[1] if i[0] == "command" else i[0])


def edges(oracle: Oracle) -> set[Edge]:
    """Every step of the graph that changes the phase, restarts included.

    A prescriber that begins to compute its next proposal counts too: it stays NEGOTIATING, but
    waits for its application from then on, not for its target.
    """
    return {
        Edge(
            before[_ROLE] if before[_ROLE] != "none" else after[_ROLE],
            before[_PHASE],
            after[_PHASE],
            event(oracle.inputs[step.input]),
            step.effect.rule,
            _told(step.effect.told),
        )
        for number, before in enumerate(oracle.states)
        for step in oracle.changes(number)
        for after in (oracle.states[step.next],)
        if before[_PHASE] != after[_PHASE] or after[_DECIDING] > before[_DECIDING]
    }


def _told(told: Json) -> str:
    if told[0] == "nothing":
        return ""
    return f"{told[0]}({told[1]})" if len(told) > 1 else str(told[0])


def phases(found: set[Edge], role: str) -> list[str]:
    """The phases of a role as a breadth-first walk from STANDALONE meets them."""
    met = ["STANDALONE"]
    for phase in met:
        ways = _by_rule({e for e in found if e.role == role and e.source == phase})
        met += [target for target in dict.fromkeys(e.target for e in ways) if target not in met]
    return met


def _by_rule(found: set[Edge]) -> list[Edge]:
    order = list(RULES)
    return sorted(found, key=lambda e: (order.index(e.rule), e.event, e.told, e.target))


def _lines(found: set[Edge], between: set[Edge]) -> Iterator[str]:
    """The lines of one arrow's label: events by rule.

    What the application is told is added where the event alone does not say which way it goes.
    """
    by_rule: dict[str, list[str]] = defaultdict(list)
    for edge in _by_rule(between):
        elsewhere = any(
            (e.role, e.source, e.event) == (edge.role, edge.source, edge.event)
            and e.target != edge.target
            for e in found
        )
        text = f"{edge.event} / {edge.told}" if elsewhere and edge.told else edge.event
        if text not in by_rule[edge.rule]:
            by_rule[edge.rule].append(text)
    return (f"{', '.join(texts)} ({rule})" for rule, texts in by_rule.items())


def diagram(found: set[Edge], role: str) -> str:
    """One role as Mermaid; restarts are not drawn."""
    drawn = {edge for edge in found if edge.role == role and edge.event != "restart"}
    order = phases(found, role)
    lines = ["stateDiagram-v2", "    [*] --> STANDALONE"]
    for source in order:
        for target in order[1:] + order[:1]:
            between = {e for e in drawn if (e.source, e.target) == (source, target)}
            if between:
                label = "<br/>".join(_lines(drawn, between))
                lines.append(f"    {source} --> {target} : {label}")
    return "\n".join(lines)


def text(oracle: Oracle) -> str:
    """Both diagrams as a Markdown page."""
    found = edges(oracle)
    parts = [_HEAD]
    for role in ROLES:
        parts.append(f"## {role.capitalize()}\n\n```mermaid\n{diagram(found, role)}\n```\n")
    return "\n".join(parts)


_HEAD = """\
# State diagrams

Generated from the graph of one station by `make generate`; `make verify` fails when it is stale.

Each arrow stands for all steps of the graph that lead from one phase to another. Its label names
the events, each with the rule that decides (`protocol.md`):

- a message received, by its type (`Fin`, `Ack of Intention`);
- a command of the application (`prescribe`, `abort`);
- a timer that `expires`.

Where an event can lead to more than one phase, what the application is told follows a `/`. An
arrow says that such a step exists; under which conditions it is taken, its rule says.

Not drawn: a restart, which leads from every phase of both roles to STANDALONE (END-8); and
whatever leaves the phase as it is, such as a refusal, an Ack of a copy, or a message that is sent
again. There is one exception. A prescriber that is refused with a round left stays NEGOTIATING but
now waits for its application instead of its target; the loop shows that.
"""
