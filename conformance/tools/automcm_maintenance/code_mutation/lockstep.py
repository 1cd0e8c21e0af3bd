"""Compares the outputs of a mutant with another state to the reference, on a product of two graphs.

The unchanged reference runs in a process of its own.  Where a step gives the two different states,
the difference is carried to the next state of the graph if it is new there, and both get all
inputs, also those that no graph has.  If their messages, indications, timers and deadlines are
always equal, the mutant is equivalent on this graph.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Set
from contextlib import contextmanager
from typing import Any

from automcm_maintenance.code_mutation.behaviour_digest import AnyState
from automcm_spec.support import children
from automcm_spec.vocabulary.json_forms import to_json

Changed = dict[str, Any]
"""Fields of a state, with the mutant's values where these differ."""
Json = Any
Ask = Callable[[int, bool], Json]
"""For a state by number, and whether all kinds of input are given: the outcomes of ``answers``."""


def answers(walker: AnyState, n: int, kinds: Set[str] | None) -> Json:
    """The outcomes of the extra inputs in a state; its fields; and by input the outcome and the
    fields then, if they are others."""
    here = walker.at(n)
    extra, outcomes = walker.extra_outcomes(here), {}
    for i, value in enumerate(walker.oracle.inputs):
        if walker.oracle.answer(n, i) is not None and (kinds is None or walker.kinds[i] in kinds):
            outcome, then = walker.outcome(here, value)
            outcomes[str(i)] = outcome, None if then is here else _fields(then)
    return extra, _fields(here), outcomes


def _fields(state: Any) -> dict[str, str]:
    return {name: repr(value) for name, value in state._asdict().items()}


def serve(walker: AnyState, kinds: Set[str] | None, lines: Iterable[str]) -> Iterator[str]:
    """The lines that answer those of ``unchanged``."""
    for line in lines:
        n, whole = json.loads(line)
        yield json.dumps(answers(walker, n, None if whole else kinds))


@contextmanager
def unchanged(graph: str, variant: str, kinds: Iterable[str]) -> Iterator[Ask]:
    """The unchanged reference in a process of its own."""
    child = "automcm_maintenance.code_mutation.mutated_process"
    task = ["state", "-", "serve", graph, variant, "-", *kinds]
    command = children.ending_with_parent([sys.executable, "-m", child, *task])
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None and process.stdout is not None
        given, answered = process.stdin, process.stdout

        def ask(n: int, whole: bool) -> Json:
            given.write(f"{json.dumps([n, whole])}\n")
            given.flush()
            return json.loads(answered.readline())

        try:
            yield ask
        finally:
            process.kill()


def distinguished(
    wrong: AnyState, right: Ask, kinds: Set[str] | None = None
) -> list[object] | None:
    """The first difference of outputs: the state, the mutant's changes of it, the input, and both
    outcomes.  None without a difference.

    With ``kinds``, only inputs of these kinds can differ where both have the same state.
    """
    oracle = wrong.oracle
    left: deque[tuple[int, Changed]] = deque((n, {}) for n in range(len(oracle.states)))
    seen: set[tuple[int, str]] = set()
    while left:
        n, changed = left.popleft()
        state = to_json(oracle.states[n])
        extra, here, outcomes = right(n, bool(changed))
        other = wrong.at(n)._replace(**changed)
        others = wrong.extra_outcomes(other)
        if extra != others:
            return [state, repr(changed), "an extra input", str(extra), str(others)]
        for i, (right_outcome, after) in outcomes.items():
            value, answer = oracle.inputs[int(i)], oracle.answer(n, int(i))
            assert answer is not None
            wrong_outcome, then = wrong.outcome(other, value)
            if right_outcome != wrong_outcome:
                return [state, repr(changed), to_json(value), right_outcome, wrong_outcome]
            if after is None and then is other:
                continue
            fields = after or here
            differs = {k: v for k, v in then._asdict().items() if repr(v) != fields[k]}
            place = (answer.next, repr(differs))
            if differs and place not in seen:
                seen.add(place)
                left.append((answer.next, differs))
    return None
