"""Timers: what a log calls them, and what the specification does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from automcm_spec.station import Entry, Timer
from automcm_traces.log import Parameters
from automcm_traces.step import Step
from automcm_traces.track import Expected, Track

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
        "quarantine": _quarantine(p),
    }


def lease_lasts(clock_drift: int | None, role: str, lease_ms: int) -> int:
    """How long the lease timer lasts, ms (ACT-4): the prescriber's is shorter by what its clock may
    lose meanwhile, ``clock_drift`` percent (none if it is not told), and 1 ms for rounding."""
    if role != "prescriber" or not clock_drift:
        return lease_ms
    return max(1, lease_ms - -(-lease_ms * clock_drift // 100) - 1)


def longest_delay(p: Parameters) -> int:
    """D, how long a copy may be under way, ms: half of t_resend (protocol.md, section 3).  A timer
    may be as late, unless told otherwise.
    """
    return (p.t_resend or 100) // 2


def _quarantine(p: Parameters) -> int | None:
    """Longer than an Advertisement is heard, and than a prescriber acts on the word of a receiver
    that has gone (END-8, ACT-6)."""
    heard = _sum(p.t_advertise, p.t_life)
    acted_on = None if p.t_resend is None else _sum(p.t_cam_loss, p.t_resend // 2)
    return None if heard is None or acted_on is None else max(heard, acted_on)


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
    track: Track, sent: Sequence[tuple[Expected, dict[str, Json]]], timer: Timer
) -> dict[str, Json]:
    """A timer of the specification as a log names it; ``sent`` is what the step sent."""
    if timer[0] == "forget":
        return {"name": timer[0], "station": timer[1]}
    if timer[0] not in ("resend", "giveup"):
        return {"name": timer[0]}
    type_, to = timer[1].type, timer[1].to
    messages = [e.message for e in track.outbox if e.spec == timer[1]]
    messages += [m for e, m in sent if (e.type, e.dst) == (type_, to)]
    if type_ == "Advertisement" and track.advertisement is not None:
        messages.append(track.advertisement)
    m = messages[0]
    about: dict[str, Json] = {"type": type_, "to": to} if to else {"type": type_}
    return {"name": timer[0], "message": about | {"session": m["session"], "seq": m["seq"]}}


def match(track: Track, step: Step, timer: dict[str, Json], pool: list[Timer]) -> Timer | None:
    """The timer of the specification that this one of a log is."""
    for one in pool:
        if one[0] != timer["name"]:
            continue
        if one[0] == "forget" and one[1] != timer.get("station"):
            continue
        if one[0] in ("resend", "giveup") and not _about(track, step, timer, one[1]):
            continue
        return one
    return None


def _about(track: Track, step: Step, timer: dict[str, Json], entry: Entry) -> bool:
    """Whether a timer of a message is the one of this entry."""
    named = timer.get("message")
    if named is None or named["type"] != entry.type or named.get("to", 0) != entry.to:
        return False
    about = named["seq"], list(named["session"])
    sent = [m for e, m in step.sent if (e.type, e.dst) == (entry.type, entry.to)]
    if entry.type == "Advertisement" and track.advertisement is not None:
        sent.append(track.advertisement)
    if any((m["seq"], m["session"]) == about for m in sent):
        return True
    if entry.type == "Advertisement":
        return False
    found = track.entry_by_seq(named)
    return found is not None and (found.session, found.k) == (entry.session, entry.seq)


def short(timer: Timer) -> str:
    """A timer of the specification in words."""
    if timer[0] in ("resend", "giveup"):
        return f"{timer[0]}({timer[1].type})"
    return str(timer[0])
