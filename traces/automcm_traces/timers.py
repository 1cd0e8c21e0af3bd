"""Timers: what a log calls them, and what the oracle does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from automcm_traces.log import Parameters
from automcm_traces.step import Step
from automcm_traces.track import Expected, Track, View

Json = Any
TIMER_RULES = {
    "advertise": "PRE-1",
    "answer": "NEG-8",
    "backoff": "END-7",
    "cam": "ACT-2",
    "decide": "PRE-5",
    "forget": "ADV-8",
    "giveup": "REL-1",
    "hold": "ADV-7",
    "lease": "ACT-4",
    "quarantine": "END-8",
    "resend": "REL-1",
}
"""The rule that a timer which is too early or too late breaks."""


def durations(p: Parameters) -> dict[str, int | None]:
    """How long timers last, ms (protocol.md, section 3); None if the header does not tell."""
    return {
        "advertise": p.t_advertise,
        "resend": p.t_resend,
        "giveup": p.t_giveup,
        "decide": p.t_decide,
        "hold": p.t_hold,
        "answer": _sum(p.t_decide, p.t_giveup),
        "cam": p.t_cam_loss,
        "quarantine": _sum(p.t_advertise, p.t_life),
    }


def longest_delay(p: Parameters) -> int:
    """D, how long a copy may be under way, ms: half of t_resend (protocol.md, section 3).  A timer
    may be as late, unless told otherwise.
    """
    return (p.t_resend or 100) // 2


def _sum(a: int | None, b: int | None) -> int | None:
    return None if a is None or b is None else a + b


def timer_name(timer: Mapping[str, Json]) -> str:
    """A timer of a log in words."""
    m = timer.get("message")
    if m is not None:
        return f"{timer['name']}({m['type']} seq={m['seq']} to {m.get('to', 'all')})"
    return f"{timer['name']}({timer['station']})" if "station" in timer else str(timer["name"])


def timer_key(timer: Mapping[str, Json]) -> str:
    """The same, told apart from those of other sessions too."""
    m = timer.get("message")
    return timer_name(timer) + (f" session={m['session'][0]}/{m['session'][1]}" if m else "")


def named(
    track: Track, sent: Sequence[tuple[Expected, dict[str, Json]]], view: View, value: Json
) -> dict[str, Json]:
    """A timer of the oracle as a log names it; ``sent`` is what the step sent."""
    if value[0] == "forget":
        return {"name": value[0], "station": view.real_id(value[1])}
    if value[0] not in ("resend", "giveup"):
        return {"name": value[0]}
    type_, to = value[1][0], view.real_id(value[1][1])
    waiting = [e for e in track.outbox if e.to in view.ids and view.entry(e) == value[1]]
    messages = [e.message for e in waiting]
    messages += [m for e, m in sent if (e.type, e.dst) == (type_, to)]
    if type_ == "Advertisement" and track.advertisement is not None:
        messages.append(track.advertisement)
    m = messages[0]
    about: dict[str, Json] = {"type": type_, "to": to} if to else {"type": type_}
    return {"name": value[0], "message": about | {"session": m["session"], "seq": m["seq"]}}


def match(
    track: Track, step: Step, timer: dict[str, Json], pool: list[tuple[View, Json]]
) -> tuple[View, Json] | None:
    """The oracle's timer that this one is."""
    for view, value in pool:
        if value[0] != timer["name"]:
            continue
        if value[0] == "forget" and view.real_id(value[1]) != timer.get("station"):
            continue
        if value[0] in ("resend", "giveup") and not _about(track, step, view, timer, value[1]):
            continue
        return view, value
    return None


def _about(track: Track, step: Step, view: View, timer: dict[str, Json], entry: Json) -> bool:
    """Whether a timer of a message is the oracle's timer of that entry."""
    named = timer.get("message")
    if named is None:
        return False
    type_, to, session, k, _ = entry
    if named["type"] != type_ or named.get("to", 0) != (view.real_id(to) if to else 0):
        return False
    about = named["seq"], list(named["session"])
    sent = [m for e, m in step.sent if (e.type, e.dst) == (type_, named.get("to", 0))]
    if type_ == "Advertisement" and track.advertisement is not None:
        sent.append(track.advertisement)
    if any((m["seq"], m["session"]) == about for m in sent):
        return True
    if type_ == "Advertisement":
        return False
    found = track.entry_by_seq(named)
    return found is not None and view.entry(found)[2:4] == (session, k)


def short(value: Json) -> str:
    """A timer of the oracle in words."""
    if value[0] in ("resend", "giveup"):
        return f"{value[0]}({value[1][0]})"
    return str(value[0])
