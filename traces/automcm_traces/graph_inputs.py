"""A log's inputs in the ids of the finite graph."""

from __future__ import annotations

from typing import Any

from automcm_traces.graph_view import ME, NOBODY, STRANGER, View, Y, others
from automcm_traces.inputs import Asked, marked_and_newer
from automcm_traces.log import ApplicationCommand, Event, Receive, TimerEnd
from automcm_traces.timers import timer_name
from automcm_traces.track import NUMBERED, ROUNDS, Track, number_of

Json = Any


def other(track: Track, y: int) -> int:
    """The other station in view if an event is about ``y``; 0 if there is none."""
    return next(iter(others(track, y)), 0)


def asked(t: Track, event: Event) -> Asked:
    """What a logged input asks.  Raises KeyError for a field that a message lacks."""
    match event:
        case Receive(message=dict(m)):
            return received(t, event, m)
        case ApplicationCommand(command=given):
            return command(t, {"name": given.name, **(given.model_extra or {})})
        case TimerEnd(timer=timer):
            return expired(t, timer.model_dump(exclude_none=True))
    return Asked(("restart",), "restart", view=View(t, other(t, 0)))


def received(t: Track, event: Receive, m: dict[str, Json]) -> Asked:
    """A message of the seven, or a CAM.  Raises KeyError for a field that it lacks."""
    src = m["src"]
    what = f"receive {m['type']} from {src}"
    if m["type"] == "CAM":
        y = NOBODY if src == t.me else src  # an echo is nobody's CAM (ACT-5)
        view = View(t, y, other(t, y), t.session)
        marked, newer = marked_and_newer(t, m)
        marks = (view.sessions(t.session),) if marked else ()
        return Asked(("cam", Y, marks, newer), what, m, view=view)
    y = 0 if src == t.me else src
    view = View(t, y, other(t, y), m["session"], m.get("proposal", 0))
    content = {"planned": event.planned} if event.planned is not None else {}
    concerned = _misdirected(t, m) or (
        m["type"] != "Ack"
        and not (m["type"] == "Advertisement" and not content and m["session"][0] == src)
    )
    return Asked(("receive", _message(t, view, m), concerned), what, m, content, view)


def command(t: Track, c: dict[str, Json]) -> Asked:
    """A command of the application."""
    name, session = c["name"], c.get("session")
    proposal, target = c.get("proposal", 0), c.get("target", 0)
    if target == t.me or (name == "prescribe" and not target):
        target = NOBODY  # whom it has not recorded (PRE-2)
    y = target or t.peer
    view = View(t, y, other(t, y), session, proposal)
    real = view.sessions(session) if name != "request" else (0, 0)
    k = view.proposals(proposal)
    about_proposal = name in ("prescribe", "accept", "refuse")
    if k > ROUNDS or (about_proposal and not k):
        # a wrong one, then; the oracle knows commands from 1 to 3 (PRE-5)
        current = view.proposals(t.proposal)
        k = current or 2 if name == "prescribe" else current % ROUNDS + 1
    value = ("command", name, real, k, view.ids.get(target, 0))
    return Asked(value, f"command {name}", c, c, view)


def expired(t: Track, timer: dict[str, Json]) -> Asked:
    """An armed timer; one of a message is of the Advertisement or of one in the outbox."""
    name, y, session, k = timer["name"], timer.get("station", 0), None, 0
    entry = t.entry_by_seq(timer["message"]) if "message" in timer else None
    if entry is not None:
        y, session, k = entry.to, entry.session, entry.k
    z = other(t, y)
    if not y:
        z = next((p for p in others(t, 0) if p != z), 0) if z else 0
        y = other(t, 0)
    view = View(t, y, z, session, k)
    value: Json = (name,)
    if entry is not None:
        value = (name, view.entry(entry))
    elif "message" in timer:
        value = (name, ("Advertisement", 0, view.sessions(t.session), 1, False))
    elif name == "forget":
        value = (name, view.ids[y])
    return Asked(("expire", value), f"expire {timer_name(timer)}", view=view)


def _misdirected(t: Track, m: dict[str, Json]) -> bool:
    """MSG-1, END-5: whatever it holds, where it comes from or goes to settles it."""
    dst, to_all = m.get("dst", 0), m["type"] == "Advertisement"
    return m["src"] == t.me or dst not in (0, t.me) or (dst == 0) != to_all


def _message(t: Track, view: View, m: dict[str, Json]) -> Json:
    """A received message in the oracle's ids; a broken one as its kind in the alphabet."""
    type_, dst = m["type"], m.get("dst", 0)
    src = ME if m["src"] == t.me else Y
    if dst not in (0, t.me):
        return _template(type_, Y, STRANGER, (Y if type_ == "Advertisement" else ME, 1))
    if _misdirected(t, m):
        to = ME if dst else 0
        if src == ME and type_ != "Advertisement":
            to = ME
        own = type_ != "Advertisement" or src == ME
        return _template(type_, src, to, (ME if own else Y, 1))
    session = view.sessions(m["session"])
    k, proposal = number_of(m), m.get("proposal", 0)
    accepted, reason, of = m.get("accepted", False), m.get("reason", "none"), ("none", 0)
    if type_ in NUMBERED:
        if session[0] != (Y if type_ == "Prescription" else ME):
            return _template(type_, src, ME, session)
        proposal = view.proposals(proposal)
        k = proposal if k else 0
    if reason not in ("none", "busy", "unknown_session", "closed"):
        reason = "as_sent"
    if type_ == "Ack":
        of = _acked(t, view, m)
    return (type_, src, dst and ME, session, k, proposal, accepted, reason, of)


def _acked(t: Track, view: View, m: dict[str, Json]) -> Json:
    """What an Ack names: an entry of the outbox, or something that matches nothing (END-6)."""
    of = m["of"]
    entry = t.entry_by_seq(
        {"type": of["type"], "to": m["src"], "session": m["session"], "seq": of["seq"]}
    )
    if entry is None or not of["seq"]:
        return ("Cancel", 0)
    return (entry.type, view.entry(entry)[3])


def _template(type_: str, src: int, dst: int, session: Json) -> Json:
    """The alphabet's one message of a type that comes from or goes to where it must not."""
    proposal = 1 if type_ in NUMBERED else 0
    reason = "as_sent" if type_ == "Cancel" else "none"
    of = ("Cancel", 1) if type_ == "Ack" else ("none", 0)
    k = 0 if type_ == "Ack" else 1
    return (type_, src, dst, session, k, proposal, type_ == "Acceptance", reason, of)
