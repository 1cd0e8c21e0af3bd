"""State diagrams of both roles, as an implementation declares them.

The arrows and their rules are the declaration's; the events come from the graph of one station,
seen as (role, phase) alone.  Both must name the same ways.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from automcm_maintenance.documents.repository import PAGES
from automcm_spec.graph.oracle import Oracle
from automcm_spec.support import templates
from automcm_spec.vocabulary.rules import RULES
from automcm_spec.vocabulary.station import Command, Entry, Expire, Input, Receive

ROLES = ("prescriber", "receiver")
RESTART = "END-8"
"""The rule of the ways that are declared and compared but not drawn."""
Way = tuple[str, str, str, str]
"""Role, phase before, phase after, and the rule by which."""


@dataclass(frozen=True, slots=True)
class Edge:
    """A step from one phase of a role to another, by an event, under a rule."""

    role: str
    source: str
    target: str
    event: str
    rule: str
    indication: str
    """The indication to the application; empty for none."""

    @property
    def way(self) -> Way:
        """The transition's key in the diagrams."""
        return self.role, self.source, self.target, self.rule


def event(i: Input) -> str:
    """An input in a word or two: a message by its type, a command by its name, a timer."""
    match i:
        case Receive(message=message):
            if message.type == "Ack":
                return f"Ack of {message.of[0]}"
            if message.type == "Acceptance":
                return f"Acceptance({'accepted' if message.accepted else 'refused'})"
            return message.type
        case Expire(timer=(name, Entry() as entry)):
            return f"{name}({entry.type}) expires"
        case Expire(timer=timer):
            return f"{timer[0]} expires"
        case Command(name=name):
            return name
    return i.kind


def edges(oracle: Oracle) -> set[Edge]:
    """Every step of the graph that changes the phase, restarts included.

    A prescriber that begins to compute its next proposal counts too: it stays NEGOTIATING, but
    waits for its application from then on, not for its target.
    """
    return {
        Edge(
            before.role if before.role != "none" else after.role,
            before.phase,
            after.phase,
            event(oracle.inputs[step.input]),
            step.effect.rule,
            _indication_text(step.effect.indication),
        )
        for number, before in enumerate(oracle.states)
        for step in oracle.changes(number)
        for after in (oracle.states[step.next],)
        if before.phase != after.phase or after.deciding > before.deciding
    }


def _indication_text(indication: tuple[str, ...]) -> str:
    name, *about = indication
    return "" if name == "nothing" else f"{name}({about[0]})" if about else name


def check(declared: Collection[Way], found: set[Edge]) -> None:
    """Raises ValueError if the ways declared are not exactly those of the graph."""
    in_graph = {edge.way for edge in found}
    only = {"declared": set(declared) - in_graph, "in the graph": in_graph - set(declared)}
    wrong = [
        f"only {where}: {role} {source} to {target} by {rule}"
        for where, ways in only.items()
        for role, source, target, rule in sorted(ways)
    ]
    if wrong:
        raise ValueError("the declared phases and the graph differ: " + "; ".join(wrong))


def _label(way: Way, found: set[Edge]) -> str:
    """A line of an arrow's label: the rule and its events.

    The indication is added if the event alone does not determine the transition.
    """
    role, source, target, rule = way
    texts = []
    among = [edge for edge in found if edge.way == way]
    for edge in sorted(among, key=lambda e: (e.event, e.indication)):
        alike = [e for e in found if (e.role, e.source, e.event) == (role, source, edge.event)]
        if edge.indication and any(e.target != target for e in alike):
            texts.append(f"{edge.event} / {edge.indication}")
        else:
            texts.append(edge.event)
    return f"{', '.join(dict.fromkeys(texts))} ({rule})"


def diagram(declared: Collection[Way], found: set[Edge], role: str) -> str:
    """One role as Mermaid, its phases in the order of the declaration; restarts are not drawn.

    Raises ValueError: see ``check``.
    """
    check(declared, found)
    ways = [way for way in declared if way[0] == role and way[3] != RESTART]
    order = list(dict.fromkeys(source for _, source, _, _ in ways))
    by_rule = list(RULES).index
    lines = ["stateDiagram-v2", "    [*] --> STANDALONE"]
    for source in order:
        for target in order[1:] + order[:1]:
            rules = [rule for _, before, after, rule in ways if (before, after) == (source, target)]
            if rules:
                ordered = sorted(rules, key=by_rule)
                label = "<br/>".join(_label((role, source, target, r), found) for r in ordered)
                lines.append(f"    {source} --> {target} : {label}")
    return "\n".join(lines)


def text(oracle: Oracle, declared: Collection[Way]) -> str:
    """Both diagrams as a Markdown page.  Raises ValueError: see ``check``."""
    found = edges(oracle)
    drawn = {role: diagram(declared, found, role) for role in ROLES}
    return templates.page(PAGES / "state-diagrams.md.j2", diagrams=drawn)
