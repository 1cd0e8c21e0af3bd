"""Why a log diverges: the nearest thing that was allowed, the guard in the way, what else fits."""

from __future__ import annotations

from typing import Any

from automcm_traces.asking import state_place
from automcm_traces.graph_inputs import asked, other
from automcm_traces.graph_view import View
from automcm_traces.guards import armed_in, causes, names, nearest, timer_in, unarmed
from automcm_traces.step import Diverges, Why
from automcm_traces.track import CannotTell, Track

Json = Any


UNKNOWN = ("resend",), ("giveup",)
"""Timers of a message that the log does not tell."""


def why(d: Diverges, track: Track) -> Why:
    """What is known of a divergence of a station that was in the state of ``track``."""
    step = d.step
    view, value = _question(d, track)
    told = _state(view.track)
    try:
        graph, place = state_place(view)
    except CannotTell:
        return Why(state=told)
    before, seen = graph.states[place], d.seen or _lacking(d)
    found, after = None, []
    if step is not None and seen and value is not None:
        full = step.rule == "MEM-1"
        found = nearest(graph, before, value, seen, full=full)
    elif seen and seen[0] == "expire":
        timer = timer_in(view, seen[1])
        if tuple(timer) not in UNKNOWN:
            found = unarmed(graph, before, timer)
            phases = armed_in(graph, timer) if len(timer) == 1 else []
            after = [f"a step into {', '.join(phases)}"] if phases else []
    written = names(view, step.given if step else None)
    if found is None and seen and seen[0] not in ("without", "expire"):
        after = causes(graph, before, seen, written)
    return Why(found.text(written) if found else "", tuple(after), told)


def _question(d: Diverges, track: Track) -> tuple[View, Json]:
    """The part of the station that the step is about, and its input, in the ids of the graph."""
    step = d.step
    if step is None or (step.event is None and step.found is None):
        return _view(d, track), None
    if step.found is not None:
        return step.found.view, step.found.value
    assert step.event is not None
    question = asked(track, step.event)
    return question.view, question.value


def _view(d: Diverges, track: Track) -> View:
    """What an effect that nothing called for is about."""
    named = d.seen[1] if d.seen and isinstance(d.seen[1], dict) else {}
    y = named.get("dst") or named.get("station") or track.peer
    return View(track, y, other(track, y), named.get("session"), named.get("proposal", 0))


def _lacking(d: Diverges) -> tuple[Json, ...]:
    """The first thing that is missing after a step, in the words of ``guards``."""
    step = d.step
    if step is None:
        return ()
    if step.messages:
        return ("without", "send", step.messages[0].type)
    for kind, pool in (("arm", step.arm), ("stop", step.stop)):
        if pool:
            return ("without", kind, pool[0][0])
    return ("without", "told", *step.told[:1])


def _state(t: Track) -> str:
    """A station in one line, only what is not empty."""
    words = [t.phase]
    if t.session is not None:
        words.append(f"{t.role} of {t.session[0]}/{t.session[1]}")
    for name, value in (
        ("target", t.target),
        ("proposal", t.proposal),
        ("recorded", t.recorded),
        ("withdrawn", sorted(t.withdrawn)),
        ("outbox", [f"{e.type} to {e.to} seq={e.message['seq']}" for e in t.outbox]),
    ):
        if value:
            words.append(
                f"{name} {value if isinstance(value, int) else ', '.join(map(str, value))}"
            )
    words += [word for word, is_ in _FLAGS.items() if getattr(t, is_)]
    return "; ".join(words)


_FLAGS = {"deciding": "deciding", "in quarantine": "quarantine", "in back-off": "backoff"}
