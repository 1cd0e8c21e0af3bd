"""Why a log diverges: the nearest thing that was allowed, the guard in the way, what else fits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from automcm_spec.oracle import Oracle
from automcm_traces.asking import state_place
from automcm_traces.engine import Diverges
from automcm_traces.guards import Nearest, armed_in, causes, names, nearest, unarmed
from automcm_traces.inputs import other
from automcm_traces.log import Header
from automcm_traces.track import CannotTell, Track, View

Json = Any
_FATE = {"indication": "told"}


@dataclass(frozen=True, slots=True)
class Why:
    """What would have been allowed instead; texts for a person, empty where nothing is known."""

    nearest: str = ""
    causes: tuple[str, ...] = ()
    """Inputs that would have led to what the log says."""
    state: str = ""
    """The station before the event."""

    def as_dict(self) -> dict[str, Json]:
        return {"nearest": self.nearest, "causes": list(self.causes), "state": self.state}

    def lines(self) -> list[str]:
        """One thing a line."""
        found = [self.nearest] if self.nearest else []
        if self.causes:
            found.append(f"allowed after: {'; '.join(self.causes)}")
        return [*found, f"state before: {self.state}"] if self.state else found


def why(d: Diverges, track: Track, header: Header) -> Why:
    """What is known of a divergence of a station that was in the state of ``track``."""
    view = _view(d, track)
    state = _state(view.track)
    try:
        graph, place = state_place(view)
    except CannotTell:
        return Why(state=state)
    before, seen = graph.states[place], _observed(d)
    written = names(view, _limits(header))
    if not seen:
        return Why(state=state)
    found: Nearest | None = None
    after: list[str] = []
    if d.step is not None:
        found = nearest(graph, before, _lists(d.step.input), seen)
    elif seen[0] == "expire":
        found, after = _expiry(graph, before, view, seen[1])
    if found is None and seen[0] != "without" and seen[0] != "expire":
        after = causes(graph, before, seen, written)
    return Why(found.text(written) if found else "", tuple(after), state)


def _expiry(
    graph: Oracle, before: Json, view: View, timer: dict[str, Json]
) -> tuple[Nearest | None, list[str]]:
    """Why a timer does not run; if it is one that runs in some phases only, in which."""
    if timer["name"] in ("resend", "giveup", "forget"):
        return None, []
    value = [timer["name"]]
    phases = armed_in(graph, value)
    where = [f"this timer runs in {', '.join(phases)}"] if len(phases) < 8 else []
    return unarmed(graph, before, value), where


def _view(d: Diverges, track: Track) -> View:
    if d.step is not None:
        return d.step.view
    named = d.seen[1] if d.seen and isinstance(d.seen[1], dict) else {}
    y = named.get("dst") or named.get("station") or track.peer
    session = named.get("session")
    return View(track, y, other(track, y), session, named.get("proposal", 0))


def _observed(d: Diverges) -> list[Json]:
    """What the log has, or lacks, in the words of ``guards``."""
    if not d.seen:
        return _lacking(d)
    kind, what = d.seen
    if kind == "send":
        if what["type"] == "CAM":
            return []
        words = ["send", what["type"]]
        words += [what.get("accepted", False)] if what["type"] == "Acceptance" else []
        return words + ([what["reason"]] if "reason" in what else [])
    if kind == "expire":
        return ["expire", what]
    if kind in ("arm", "stop"):
        return [kind, what["name"]]
    return [_FATE.get(kind, kind), what]


def _lacking(d: Diverges) -> list[Json]:
    step = d.step
    if step is None:
        return []
    if step.messages:
        return ["without", "send", step.messages[0].type]
    for kind, pool in (("arm", step.arm), ("stop", step.stop)):
        if pool:
            return ["without", kind, pool[0][1][0]]
    return ["without", "told", *step.told[:1]]


def _limits(header: Header) -> dict[str, int]:
    p = header.parameters
    told = {
        "MaxParticipants": p.max_participants,
        "OutboxLimit": p.outbox_limit,
        "MemoryLimit": p.memory_limit,
    }
    return {name: n for name, n in told.items() if n is not None}


def _lists(value: Json) -> Json:
    return [_lists(v) for v in value] if isinstance(value, tuple) else value


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
