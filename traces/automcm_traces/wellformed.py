"""Whether a message of a log has the form that section 2 of the protocol gives it."""

from __future__ import annotations

from enum import Enum
from typing import Any

Json = Any
REFUSALS = ("unsafe", "undecided")
ANSWERED = ("busy", "unknown_session")
CANCELS = (
    *("not_selected", "not_needed", "no_agreement", "timeout", "cam_loss", "lease_expired"),
    *("abort", "closed"),
)
_COMMON = {"v": int, "type": str, "src": int, "session": list, "seq": int}
_NEEDED: dict[str, dict[str, type]] = {
    "Advertisement": {"scenario": str, "details": dict},
    "Intention": {"planned": dict},
    "Prescription": {"proposal": int, "prescribed": dict, "hold_ms": int, "lease_ms": int},
    "Acceptance": {"proposal": int, "accepted": bool},
    "Fin": {},
    "Cancel": {"reason": str},
    "Ack": {"of": dict},
}
_CAM = {
    **{"v": int, "type": str, "src": int, "generation_ms": int, "x_mm": int, "y_mm": int},
    **{"heading_mrad": int, "speed_mm_s": int, "marks": list},
}
_OPTIONAL: dict[str, dict[str, type]] = {
    "Advertisement": {"planned": dict},
    "Acceptance": {"selected": dict, "reason": str},
}
TYPES = tuple(_NEEDED)
"""The seven types."""
CONTENT = ("scenario", "details", "planned", "prescribed", "hold_ms", "lease_ms", "selected")
"""Fields that the application gives and the station carries."""
_TRAJECTORIES = ("planned", "prescribed", "selected")


class Form(Enum):
    """GOOD; MALFORMED: all fields are there, but it breaks section 2 (END-5); UNREADABLE: a
    field is missing or of another type."""

    GOOD = 0
    MALFORMED = 1
    UNREADABLE = 2


def form(m: dict[str, Json]) -> Form:
    """What form a message has: one of the seven types, or a CAM."""
    type_ = m["type"]
    if type_ == "CAM":
        needed, optional = _CAM, {}
    elif type_ in _NEEDED:
        needed = _COMMON | _NEEDED[type_]
        optional = {"dst": int} | _OPTIONAL.get(type_, {})
    else:
        return Form.MALFORMED
    for name, kind in (needed | optional).items():
        if (name in m and type(m[name]) is not kind) or (name in needed and name not in m):
            return Form.UNREADABLE
    sessions = m["marks"] if type_ == "CAM" else [m["session"]]
    if not all(_is_pair(s) for s in sessions):
        return Form.UNREADABLE
    if type_ == "Ack" and (type(m["of"].get("type")), type(m["of"].get("seq"))) != (str, int):
        return Form.UNREADABLE
    good = (
        not set(m) - set(needed) - set(optional)
        and m["v"] == 1
        and m["src"] > 0
        and all(q > 0 and n > 0 for q, n in sessions)
        and ((type_ == "CAM" and m["generation_ms"] >= 0) or (type_ != "CAM" and _fits(m)))
        and all(_is_trajectory(m[name]) for name in _TRAJECTORIES if name in m)
    )
    return Form.GOOD if good else Form.MALFORMED


def _fits(m: dict[str, Json]) -> bool:
    """Whether the values of one of the seven go together: reason and seq, for one."""
    if m.get("dst", 1) < 1 or m["seq"] < 0:
        return False
    answer = m["type"] == "Ack"
    match m["type"]:
        case "Prescription":
            if m["proposal"] < 1 or m["hold_ms"] < 0 or m["lease_ms"] < 1:
                return False
        case "Acceptance":
            accepted, reason = m["accepted"], m.get("reason")
            answer = reason in ANSWERED
            if accepted != ("selected" in m) or accepted != (reason is None):
                return False
            if m["proposal"] < 1 or reason not in (None, *REFUSALS, *ANSWERED):
                return False
        case "Cancel":
            answer = m["reason"] == "closed"
            if m["reason"] not in CANCELS:
                return False
        case "Ack":
            of = m["of"]
            if set(of) != {"type", "seq"} or of["type"] not in TYPES or of["seq"] < 0:
                return False
    return answer == (m["seq"] == 0)


def _is_pair(value: Json) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(type(n) is int for n in value)


def _is_trajectory(value: dict[str, Json]) -> bool:
    points = value.get("points")
    return (
        set(value) == {"t0", "points"}
        and type(value["t0"]) is int
        and isinstance(points, list)
        and len(points) > 0
        and all(len(p) == 3 and all(type(n) is int for n in p) for p in points if _is_list(p))
        and all(_is_list(p) for p in points)
    )


def _is_list(value: Json) -> bool:
    return isinstance(value, list)
