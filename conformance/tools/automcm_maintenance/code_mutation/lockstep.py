"""Compares a mutant with the reference on a graph: at each state, both get every input.

The unchanged reference runs in a process of its own.  Where a step gives the two different states,
the difference is carried to the next state of the graph if it is new there, and both get every
input there, too.  If their messages, indications, timers and deadlines are always equal, the mutant
is equivalent on this graph.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, BinaryIO, NamedTuple, Protocol

from automcm_spec.support import children

Changed = Mapping[str, Any]
"""Fields of a state, with the mutant's values where these differ."""
Texts = dict[str, str]
Known = tuple[Texts, list[tuple[str, Texts | None]]]
"""The fields of a state, and the outcome of each input with the fields after it."""
Ask = Callable[[int], Callable[[], Known]]
"""Asks for a state by number; what it returns waits for the answer."""


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


class Different(NamedTuple):
    """A state with different outcomes: its number, the mutant's changes of it, and by input the
    right and the wrong outcome."""

    state: int
    changed: Changed
    outcomes: list[tuple[Any, str, str]]


def serve(walked: Walked, numbers: Iterable[str], out: BinaryIO) -> None:
    """Answer the questions of ``unchanged``."""
    for n in map(int, numbers):
        answers = [(a.outcome, None if a.then is None else _texts(a.then)) for a in _all(walked, n)]
        pickle.dump((_texts(walked.fields(n, {})), answers), out)
        out.flush()


def _all(walked: Walked, n: int, changed: Changed | None = None) -> list[Answer]:
    return list(walked.answers(n, changed or {}))


def _texts(fields: Changed) -> Texts:
    return {name: repr(value) for name, value in fields.items()}


@contextmanager
def unchanged(graph: str, variant: str) -> Iterator[Ask]:
    """The unchanged reference in a process of its own."""
    child = "automcm_maintenance.code_mutation.mutated_process"
    command = children.ending_with_parent(
        [sys.executable, "-m", child, "state", "-", "serve", graph, variant]
    )
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stdout is not None
        given, answered = process.stdin, process.stdout

        def ask(n: int) -> Callable[[], Known]:
            given.write(b"%d\n" % n)
            given.flush()
            return lambda: pickle.load(answered)

        try:
            yield ask
        finally:
            process.kill()


def first_difference(wrong: Walked, right: Ask) -> Different | None:
    """The first state with different outcomes."""
    left: deque[tuple[int, Changed]] = deque((n, {}) for n in range(len(wrong.states)))
    seen: set[tuple[int, str]] = set()
    while left:
        n, changed = left.popleft()
        known = right(n)
        answers = _all(wrong, n, changed)
        here, outcomes = known()
        both = list(zip(answers, outcomes, strict=False))  # a mutant may not enter the state
        different = [(a.input, text, a.outcome) for a, (text, _) in both if a.outcome != text]
        if different:
            return Different(n, changed, different)
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
