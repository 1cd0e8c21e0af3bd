"""A log's inputs as those of the specification."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from automcm_spec.messages import ANSWER_REASONS
from automcm_spec.station import Cam, Command, Entry, Expire, Input, Message, Restart, Timer
from automcm_spec.station import Receive as Received
from automcm_traces.log import ApplicationCommand, Event, Receive, TimerEnd
from automcm_traces.timers import timer_name
from automcm_traces.track import UNBOUND, Track, number_of

Json = Any
REASONS = ("none", *ANSWER_REASONS)
"""The reasons that the specification tells apart; the others it passes on."""


class Asked(NamedTuple):
    """A question to the specification."""

    value: Input
    what: str
    """The input in words."""
    given: dict[str, Json] | None = None
    """The message or command itself."""
    content: Mapping[str, Json] = {}
    """What the application gave with it, and the station must send as it is."""


def marked_and_newer(t: Track, m: dict[str, Json]) -> tuple[bool, bool]:
    """Whether a CAM names the session, and is newer than the last that counted (ACT-5)."""
    marked = t.session is not None and list(t.session) in m["marks"]
    return marked, t.heard_ms is None or m["generation_ms"] > t.heard_ms


def asked(t: Track, event: Event) -> Asked:
    """What a logged input asks; a message in it is well-formed."""
    match event:
        case Receive(message=dict(m)):
            return received(t, event, m)
        case ApplicationCommand(command=given):
            return command({"name": given.name, **(given.model_extra or {})})
        case TimerEnd(timer=timer):
            return expired(t, timer.model_dump(exclude_none=True))
    return Asked(Restart("restart"), "restart")


def received(t: Track, event: Receive, m: dict[str, Json]) -> Asked:
    """A message of the seven, or a CAM."""
    type_, src = m["type"], m["src"]
    what = f"receive {type_} from {src}"
    if type_ == "CAM":
        marked, newer = marked_and_newer(t, m)
        marks = frozenset({t.state.session} if marked else ())
        return Asked(Cam("cam", src, marks, newer), what, m)
    reason, of = m.get("reason", "none"), ("none", 0)
    if type_ == "Ack":
        of = _acked(t, m)
    message = Message(
        type_,
        src,
        m.get("dst", 0),
        (m["session"][0], m["session"][1]),
        number_of(m),
        m.get("proposal", 0),
        m.get("accepted", False),
        reason if reason in REASONS else "as_sent",
        of,
    )
    content = {"planned": event.planned} if event.planned is not None else {}
    return Asked(Received("receive", message, bool(content)), what, m, content)


def command(c: dict[str, Json]) -> Asked:
    """A command of the application."""
    session = tuple(c.get("session") or UNBOUND)
    value = Command("command", c["name"], session, c.get("proposal", 0), c.get("target", 0))
    return Asked(value, f"command {c['name']}", c, c)


def expired(t: Track, timer: dict[str, Json]) -> Asked:
    """An armed timer."""
    return Asked(Expire("expire", timer_of(t, timer)), f"expire {timer_name(timer)}")


def timer_of(t: Track, timer: Mapping[str, Json]) -> Timer:
    """A timer of a log; one of a message is of the Advertisement or of one in the outbox."""
    name, about = timer["name"], timer.get("message")
    of: tuple[Json, ...] = (timer["station"],) if "station" in timer else ()
    if about is not None:
        entry = t.entry_by_seq(about)
        of = (entry.spec if entry else Entry("Advertisement", 0, t.state.session, 1, False),)
    return (name, *of)


def _acked(t: Track, m: dict[str, Json]) -> tuple[str, int]:
    """What an Ack names: an entry of the outbox, or something that matches nothing (END-6)."""
    of = m["of"]
    about = {"type": of["type"], "to": m["src"], "session": m["session"], "seq": of["seq"]}
    entry = t.entry_by_seq(about) if of["seq"] else None
    return (entry.type, entry.k) if entry is not None else ("Cancel", 0)
