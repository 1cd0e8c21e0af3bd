"""The form of a message in a log: docs/protocol.md, section 2.

What breaks it was no message (END-5); a log holds the bytes of such a thing as ``raw``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

Json = Any
Check = Callable[[Json], str]
"""What is wanted, if the value is not that; else an empty text."""

REASONS = {
    "Acceptance": ("unsafe", "undecided", "busy", "unknown_session"),
    "Cancel": (
        "not_selected",
        "not_needed",
        "no_agreement",
        "timeout",
        "cam_loss",
        "lease_expired",
        "abort",
        "closed",
    ),
}
ANSWERS = ("busy", "unknown_session", "closed")
"""With these reasons the message is an answer, and its seq is 0."""


LARGEST = 2**53 - 1
LONGEST_text = 65_507
DEEPEST = 32
MOST_MARKS = 255
"""The bounds of docs/messages.md."""


def _integer(value: Json) -> str:
    """An integer; true is none."""
    good = type(value) is int and -LARGEST <= value <= LARGEST
    return "" if good else "an integer within 2^53-1"


def _at_least(low: int) -> Check:
    what = f"an integer from {low} to 2^53-1"
    return lambda v: "" if type(v) is int and low <= v <= LARGEST else what


def _text(value: Json) -> str:
    good = type(value) is str and len(value) <= LONGEST_text
    good = good and (value.isascii() or not any("\ud800" <= c <= "\udfff" for c in value))
    return "" if good else "a text"


def _details(value: Json) -> str:
    return "" if type(value) is dict and _plain(value, 1) else "an object of plain values"


def _plain(value: Json, depth: int) -> bool:
    if type(value) in (list, dict):
        inside = value if type(value) is list else value.values()
        names = () if type(value) is list else value
        return (
            depth <= DEEPEST
            and not any(_text(name) for name in names)
            and all(_plain(v, depth + 1) for v in inside)
        )
    return type(value) is bool or not _integer(value) or not _text(value)


def _station(value: Json) -> str:
    return "" if type(value) is int and 1 <= value < 2**32 else "a station's id, 1 to 2^32-1"


def _session(value: Json) -> str:
    good = isinstance(value, list) and len(value) == 2 and not _station(value[0])
    good = good and type(value[1]) is int and 1 <= value[1] <= LARGEST
    return "" if good else "[prescriber, number]"


def _marks(value: Json) -> str:
    good = isinstance(value, list) and len(value) <= MOST_MARKS
    good = good and not any(_session(mark) for mark in value)
    return "" if good else f"an array of at most {MOST_MARKS} sessions"


def _trajectory(value: Json) -> str:
    good = isinstance(value, dict) and value.keys() == {"t0", "points"}
    good = good and not _integer(value["t0"]) and isinstance(value["points"], list)
    good = good and len(value["points"]) > 0 and all(_point(p) for p in value["points"])
    return "" if good else "a trajectory: t0, and points of three integers"


def _point(value: Json) -> bool:
    return isinstance(value, list) and len(value) == 3 and not any(map(_integer, value))


def _of(value: Json) -> str:
    good = isinstance(value, dict) and value.keys() == {"type", "seq"}
    good = good and value["type"] in TYPES and not _NATURAL(value["seq"])
    return "" if good else "the type and the seq of a message"


_NATURAL = _at_least(0)
_OWN: dict[str, dict[str, Check]] = {
    "Advertisement": {
        "scenario": _text,
        "details": _details,
        "planned": _trajectory,
    },
    "Intention": {"planned": _trajectory},
    "Prescription": {
        "proposal": _at_least(1),
        "prescribed": _trajectory,
        "hold_ms": _at_least(0),
        "lease_ms": _at_least(1),
    },
    "Acceptance": {
        "proposal": _at_least(1),
        "accepted": lambda v: "" if type(v) is bool else "true or false",
        "selected": _trajectory,
        "reason": _text,
    },
    "Fin": {},
    "Cancel": {"reason": _text},
    "Ack": {"of": _of},
}
TYPES = tuple(_OWN)
"""The seven types; the CAM is none of them."""
_OPTIONAL = {("Advertisement", "planned"), ("Acceptance", "selected"), ("Acceptance", "reason")}
_COMMON: dict[str, Check] = {
    "v": lambda v: "" if v == 1 and type(v) is int else "1",
    "type": _text,
    "src": _station,
}
_CAM: dict[str, Check] = {
    "generation_ms": _at_least(0),
    "x_mm": _integer,
    "y_mm": _integer,
    "heading_mrad": _integer,
    "speed_mm_s": _integer,
    "marks": _marks,
}


_HEAD: dict[str, Check] = {"session": _session, "seq": _at_least(0)}
_FIELDS = {"CAM": _COMMON | _CAM} | {
    type_: _COMMON | _HEAD | own | ({} if type_ == "Advertisement" else {"dst": _station})
    for type_, own in _OWN.items()
}


_NEEDED = {
    type_: {name for name in fields if (type_, name) not in _OPTIONAL}
    for type_, fields in _FIELDS.items()
}


def problems(m: Mapping[str, Json]) -> Iterator[tuple[str, str]]:
    """Each field in which a message is not what the protocol says, and what is wrong with it."""
    type_ = m["type"]
    fields = _FIELDS.get(type_)
    if fields is None:
        yield "type", f"{type_!r} is no message of the protocol"
        return
    bad = False
    for name in sorted(fields.keys() | m.keys()):
        if name not in fields:
            yield name, f"{type_} has no such field"
        elif name not in m:
            if (type_, name) in _OPTIONAL:
                continue
            yield name, f"missing: {type_} needs it"
        elif wanted := fields[name](m[name]):
            yield name, f"{wanted} is wanted"
        else:
            continue
        bad = True
    if not bad and type_ != "CAM":
        yield from _together(m, type_)


def malformed(m: Mapping[str, Json]) -> str | None:
    """The first field that is not as it should be, and how it should be; None if all are."""
    return next((f"{field}: {problem}" for field, problem in problems(m)), None)


def well_formed(m: Mapping[str, Json]) -> bool:
    """Whether a message is what the protocol says; what is not is discarded (END-5)."""
    type_ = m["type"]
    if type_ == "CAM":
        return _is_cam(m)
    fields = _FIELDS.get(type_)
    if fields is None or not _NEEDED[type_] <= m.keys():
        return False
    for name, value in m.items():
        check = fields.get(name)
        if check is None or check(value):
            return False
    return next(_together(m, type_), None) is None


def _is_cam(m: Mapping[str, Json]) -> bool:
    """``well_formed`` for the message that comes most often."""
    if m.keys() != _NEEDED["CAM"] or type(m["v"]) is not int or m["v"] != 1 or _station(m["src"]):
        return False
    for name in ("x_mm", "y_mm", "heading_mrad", "speed_mm_s", "generation_ms"):
        if type(m[name]) is not int or not -LARGEST <= m[name] <= LARGEST:
            return False
    return m["generation_ms"] >= 0 and not _marks(m["marks"])


def _together(m: Mapping[str, Json], type_: str) -> Iterator[tuple[str, str]]:
    """What holds between fields."""
    reason = m.get("reason")
    if type_ == "Acceptance":
        for name, wanted in (("selected", m["accepted"]), ("reason", not m["accepted"])):
            if (name in m) != wanted:
                yield (
                    name,
                    f"there if and only if it {'accepts' if name == 'selected' else 'refuses'}",
                )
    if reason is not None and reason not in REASONS[type_]:
        yield "reason", f"{reason!r} is none of {', '.join(REASONS[type_])}"
    answer = type_ == "Ack" or reason in ANSWERS
    if answer != (m["seq"] == 0):
        yield "seq", "0 in an answer, from 1 in everything else"
