"""Compares a mutant with the reference on a graph: at each state, both get every input.

The unchanged reference runs in a process of its own.  Where a step gives the two different states,
the difference is carried to the next state of the graph if it is new there, and both get every
input there, too.  If their messages, indications, timers and deadlines are always equal, the mutant
is equivalent on this graph.

This module is imported before the reference is replaced (mutated_process.py), so it imports none of
it at its head.
"""

from __future__ import annotations

import gc
import json
import sqlite3
import zlib
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple, Protocol

Changed = Mapping[str, Any]
"""Fields of a state, with the mutant's values where these differ."""


class Answer(NamedTuple):
    """The outcome of an input as text; the fields of the state after it, None if it is the same;
    and the number of that state in the graph.  ``input`` is a text if no graph has it."""

    input: Any
    outcome: str
    then: Changed | None
    next: int


class Walked(Protocol):
    """A graph with a station, or the forms of messages (accepted_forms.py)."""

    @property
    def states(self) -> Sequence[object]:
        """All states by number."""

    def fields(self, n: int, changed: Changed) -> Changed:
        """The fields of state ``n`` with these changes."""

    def answers(self, n: int, changed: Changed) -> Iterator[Answer]:
        """The answers to all inputs there, always in the same order."""


@dataclass(frozen=True)
class Difference:
    """A state and an input at which a mutant behaves differently, in the form of JSON."""

    graph: str
    state: object
    input: str
    right: str
    wrong: str


def walked(graph: str, variant: int) -> Walked:
    """The reference of this process on a graph; of the special graph ``forms`` the states are
    messages, the inputs their edge cases."""
    from automcm_maintenance.code_mutation import accepted_forms, station_behaviour
    from automcm_spec.graph.oracle import load
    from automcm_spec.graph.oracle_generation import GRAPHS

    gc.disable()  # the graph is large and permanent
    if graph == "forms":
        return accepted_forms.Forms()
    return station_behaviour.AnyState(load(GRAPHS[graph].path), station_behaviour.VARIANTS[variant])


def unchanged(graph: str, variant: int, kept: Path | str = ":memory:") -> Connection:
    """Fork a process with the reference of this one: for the number of a state it sends the fields
    of the state as text, and the outcomes of all inputs with the fields after them.

    ``kept`` is a database of what it has sent, for other mutants of the same reference.
    """
    ours, theirs = get_context("fork").Pipe()
    get_context("fork").Process(
        target=_serve, args=(theirs, ours, graph, variant, kept), daemon=True
    ).start()
    theirs.close()
    return ours


def _serve(
    asked: Connection, other: Connection, graph: str, variant: int, kept: Path | str
) -> None:
    other.close()  # so that the end of the parent closes the pipe
    right: Walked | None = None
    known = sqlite3.connect(kept, timeout=600, isolation_level=None)
    known.execute("CREATE TABLE IF NOT EXISTS sent (state INTEGER PRIMARY KEY, data BLOB)")
    while True:
        try:
            n = asked.recv()
        except EOFError:
            return
        row = known.execute("SELECT data FROM sent WHERE state = ?", (n,)).fetchone()
        if row is None:
            right = right or walked(graph, variant)
            answers = [
                (a.outcome, None if a.then is None else _texts(a.then))
                for a in right.answers(n, {})
            ]
            row = (zlib.compress(json.dumps([_texts(right.fields(n, {})), answers]).encode(), 1),)
            known.execute("INSERT OR IGNORE INTO sent VALUES (?, ?)", (n, *row))
        asked.send_bytes(zlib.decompress(row[0]))


def _texts(fields: Changed) -> dict[str, str]:
    return {name: repr(value) for name, value in fields.items()}


def first_difference(graph: str, wrong: Walked, right: Connection) -> Difference | None:
    """The first input with another outcome."""
    left: deque[tuple[int, Changed]] = deque((n, {}) for n in range(len(wrong.states)))
    seen: set[tuple[int, str]] = set()
    while left:
        n, changed = left.popleft()
        right.send(n)
        answers = list(wrong.answers(n, changed))
        here, outcomes = json.loads(right.recv_bytes())
        both = list(zip(answers, outcomes, strict=False))  # a mutant may not enter the state
        for answer, (text, _) in both:
            if answer.outcome != text:
                return _difference(graph, wrong.states[n], changed, answer, text)
        for answer, (_, after) in both:
            if answer.then is None and after is None:
                continue
            then = wrong.fields(n, changed) if answer.then is None else answer.then
            fields = here if after is None else after
            differs = {name: value for name, value in then.items() if repr(value) != fields[name]}
            place = (answer.next, repr(differs))
            if differs and place not in seen:
                seen.add(place)
                left.appendleft((answer.next, differs))  # the sooner it may show
    return None


def _difference(
    graph: str, state: object, changed: Changed, answer: Answer, right: str
) -> Difference:
    from automcm_spec.vocabulary.json_forms import canonical, to_json

    shown = to_json(state)
    given = answer.input if isinstance(answer.input, str) else canonical(answer.input)
    place = [shown, repr(changed)] if changed else shown
    return Difference(graph, place, given, right, answer.outcome)
