"""Timers: what a log calls them, and what the specification does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from automcm_spec.station import Entry, Timer
from automcm_traces.step import Step
from automcm_traces.track import Expected, Track

Json = Any


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
    match timer:
        case (name, Entry(type=type_, to=to) as entry):
            messages = [e.message for e in track.outbox if e.spec == entry]
            messages += [m for e, m in sent if (e.type, e.dst) == (type_, to)]
            if type_ == "Advertisement" and track.advertisement is not None:
                messages.append(track.advertisement)
            m = messages[0]
            about: dict[str, Json] = {"type": type_, "to": to} if to else {"type": type_}
            return {"name": name, "message": about | {"session": m["session"], "seq": m["seq"]}}
        case (name, int(station)):
            return {"name": name, "station": station}
    return {"name": timer[0]}


def match(track: Track, step: Step, timer: dict[str, Json], pool: list[Timer]) -> Timer | None:
    """The timer of the specification that this one of a log is."""
    for one in pool:
        if one[0] != timer["name"]:
            continue
        match one:
            case (_, int(station)) if station != timer.get("station"):
                continue
            case (_, Entry() as entry) if not _about(track, step, timer, entry):
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
    match timer:
        case (name, Entry() as entry):
            return f"{name}({entry.type})"
    return timer[0]
