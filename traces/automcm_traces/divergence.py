"""Why a log diverges: the nearest thing that was allowed, the guard in the way, what else fits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from automcm_traces.asking import state_place
from automcm_traces.guards import armed_in, causes, names, nearest, timer_in, unarmed
from automcm_traces.inputs import other
from automcm_traces.step import Diverges
from automcm_traces.track import CannotTell, Track, View

Json = Any


@dataclass(frozen=True, slots=True)
class Why:
    """What would have been allowed instead; texts for a person, empty where nothing is known."""

    nearest: str = ""
    causes: tuple[str, ...] = ()
    """Inputs that would have led to what the log says."""
    state: str = ""
    """The station before the event."""

    def as_dict(self) -> dict[str, Json]:
        """As in ``--json``."""
        return {"nearest": self.nearest, "causes": list(self.causes), "state": self.state}

    def lines(self) -> list[str]:
        """One thing a line."""
        found = [self.nearest] if self.nearest else []
        if self.causes:
            found.append(f"allowed after: {'; '.join(self.causes)}")
        return [*found, f"state before: {self.state}"] if self.state else found


UNKNOWN = ("resend",), ("giveup",)
"""Timers of a message that the log does not tell."""


def why(d: Diverges, track: Track) -> Why:
    """What is known of a divergence of a station that was in the state of ``track``."""
    step = d.step
    view = _view(d, track) if step is None else step.view
    told = _state(view.track)
    try:
        graph, place = state_place(view)
    except CannotTell:
        return Why(state=told)
    before, seen = graph.states[place], d.seen or _lacking(d)
    found, after = None, []
    if step is not None and seen:
        full = step.rule == "MEM-1"
        found = nearest(graph, before, step.input, seen, full=full)
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
            return ("without", kind, pool[0][1][0])
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
