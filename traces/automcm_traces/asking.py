"""Questions to the oracle, remembered; and MEM-1, which the limits of a real station decide."""

from __future__ import annotations

from functools import cache
from typing import Any

from automcm_spec.generate import ONE_PEER, TWO_PEERS, spec_hash
from automcm_spec.oracle import Answer, Effect, Oracle, canonical, load
from automcm_traces.graph_view import View
from automcm_traces.track import CannotTell, Track

Json = Any
REMEMBERED = 200_000
"""Answers kept in memory; then it starts anew."""


@cache
def oracle(two: bool) -> Oracle:
    """The graph of one station among two peers, or one.  Raises OracleError."""
    graph = TWO_PEERS if two else ONE_PEER
    return load(graph.path, spec_hash())


_answers: dict[tuple[bool, Json, Json], tuple[Answer, Json]] = {}


def ask(view: View, value: Json) -> tuple[Answer, Json]:
    """What must happen, and the state that comes next; both as nested tuples.

    Raises CannotTell if the oracle knows no such situation.
    """
    two, state = len(view.ids) > 2, view.state()
    key = two, state, value
    found = _answers.get(key)
    if found is None:
        if len(_answers) >= REMEMBERED:
            _answers.clear()
        found = _answers[key] = _asked(two, state, value)
    if found[0].effect.rule in _NEEDS_ROOM and not _room(view.track, found[0], value, view):
        return _without_room(found[0], value), state
    return found


def state_place(view: View) -> tuple[Oracle, int]:
    """The graph of a view and the state's place in it.  Raises CannotTell."""
    graph, state = oracle(len(view.ids) > 2), view.state()
    try:
        return graph, graph.state_index[canonical(_sorted(state))]
    except KeyError:
        raise CannotTell(f"not in the oracle: {canonical(state)}") from None


def _asked(two: bool, state: Json, value: Json) -> tuple[Answer, Json]:
    try:
        answer = oracle(two).ask(_sorted(state), value)
    except KeyError:
        text = f"not in the oracle: {canonical(value)} in {canonical(state)}"
        raise CannotTell(text) from None
    e = answer.effect
    effect = Effect(frozen(e.messages), e.told, e.rule, frozen(e.arm), frozen(e.stop))
    return answer._replace(effect=effect), frozen(oracle(two).states[answer.next])


def frozen(value: Json) -> Json:
    """Nested lists as nested tuples."""
    return tuple(frozen(v) for v in value) if isinstance(value, list) else value


def _sorted(state: Json) -> Json:
    """The outbox in the order of the oracle's text."""
    return [*state[:11], sorted(state[11], key=canonical), *state[12:]]


_NEEDS_ROOM = {"ADV-1", "ADV-3", "ADV-5", "END-2"}


def _room(t: Track, answer: Answer, value: Json, view: View) -> bool:
    """MEM-1: whether this station has the room that the oracle's answer takes for granted."""
    if not answer.changes:
        return True
    limits, rule = t.limits, answer.effect.rule
    if rule in ("ADV-1", "ADV-3"):
        reserve = 1 + max(limits.participants, t.max_rounds)
        if len(t.outbox) + reserve > limits.outbox:
            return False
        return rule == "ADV-1" or view.real_id(2) in t.joined or len(t.joined) < limits.memory
    src = view.real_id(value[1][1])
    counted = set(t.recorded) | t.withdrawn
    return t.phase != "ADVERTISING" or src in counted or len(counted) < limits.participants


def _without_room(answer: Answer, value: Json) -> Answer:
    """MEM-1: a request is refused, an Advertisement and an Intention are ignored, and of a
    Cancel only the Ack is left (END-3)."""
    told = ["refused"] if value[0] == "command" else ["nothing"]
    withdraws = answer.effect.rule == "END-2"
    messages = answer.effect.messages if withdraws else ()
    effect = Effect(messages, told, "END-3" if withdraws else "MEM-1", (), ())
    return answer._replace(next=answer.state, effect=effect, changes=False)
