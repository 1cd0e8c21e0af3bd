"""Messages with exactly one error (END-5), and valid messages with unusual values.

The bounds are copied from docs/messages.md on purpose, instead of being imported from
automcm_spec.vocabulary.messages, so that a wrong bound there is found.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from automcm_conformance.adapter.protocol import MESSAGE_TYPES

Json = Any
Message = dict[str, Json]
LARGE = 2**53 - 1
TEXT = 65_507
DEPTH = 32
MARKS = 255
EXTENT_MM = (100, 102_100)
TRICKY = (
    *(
        "__proto__",
        "constructor",
        "toString",
        "",
        "0",
        "01",
        " a ",
        "A\u200d",
        "\ufeffa",
        "a\u2028",
    ),
    *("\u00e9", "e\u0301", "\u212b", "\ufb01", "\u1e9b\u0323", "\u1100\u1161", "\u0130", "\u0000"),
)
"""Names and texts that a language or a library changes: of objects in JavaScript, by Unicode
normalisation, by trimming or case folding, at the end of a text in C."""
ABSENT = object()
"""The value of a field that is to be left out."""
_POINT = [0, 0, 0]
_TRAJECTORY = {"t0": 0, "points": [_POINT]}


def nested(depth: int) -> Json:
    """``details`` of this nesting depth, with lists and objects in turn."""
    value: Json = {}
    if depth % 2 == 0:
        value = []
    for n in range(depth - 1, 0, -1):
        value = {"in": value} if n % 2 else [value]
    return value


def invalid(message: Message) -> Iterator[tuple[str, Message]]:
    """Each kind of error, with a message that has only this error."""
    type_ = message["type"]
    changes: list[Message] = [{"unknown": 1}, {"type": "Proposal"}, {"type": type_.lower()}]
    changes.append({"type": 7})
    for name, value in message.items():
        changes += [{name: ABSENT}, {name: None}]
        if name != "type":
            changes += [{name: other} for other in _wrong(name, value)]
    foreign = {"proposal": 1, "reason": "abort", "marks": [], "planned": _TRAJECTORY}
    foreign |= {name: values[0] for name, values in _OPTIONAL["CAM"].items()}
    may_have = {"Advertisement": {"planned"}, "Acceptance": {"reason"}}.get(type_, set())
    may_have |= _OPTIONAL.get(type_, {}).keys()
    changes += [{n: v} for n, v in foreign.items() if n not in message.keys() | may_have]
    for name in _OPTIONAL.get(type_, ()):
        changes += [{name: other} for other in (None, *_wrong(name, 1))]
    for change in [*changes, *_UNFIT.get(type_, ())]:
        kept = {n: v for n, v in {**message, **change}.items() if v is not ABSENT}
        yield ", ".join(f"{n} {_told(v)}" for n, v in change.items()), kept


def _told(value: Json) -> str:
    if value is ABSENT:
        return "left out"
    text = repr(value)
    return text if len(text) < 80 else f"{text[:60]}… ({len(text)} characters)"


_EXTENTS: dict[str, tuple[int, ...]] = {"length_mm": EXTENT_MM, "width_mm": EXTENT_MM}
_OPTIONAL: dict[str, dict[str, tuple[int, ...]]] = {
    "Intention": _EXTENTS,
    "CAM": _EXTENTS | {"station_type": (0, 255), "sigma_mm": (0, LARGE)},
}
"""Optional fields about the vehicle, each with its least and greatest value."""
_NO_TRAJECTORIES: tuple[Json, ...] = (None, [], {"t0": 0}, {"t0": 0, "points": [[0, 0]]})
_REFUSES: Message = {"accepted": False, "selected": ABSENT}
_UNFIT: dict[str, list[Message]] = {
    "Advertisement": [
        {"seq": 0},
        *({"planned": value} for value in _NO_TRAJECTORIES),
    ],
    "Intention": [{"seq": 0}],
    "Prescription": [{"seq": 0}],
    "Acceptance": [
        {"seq": 0},
        {"reason": "unsafe"},
        {"accepted": False},
        {"accepted": False, "reason": "unsafe"},
        _REFUSES,
        _REFUSES | {"reason": "abort"},
        _REFUSES | {"reason": "unsafe", "seq": 0},
        _REFUSES | {"reason": "undecided", "seq": 0},
        _REFUSES | {"reason": "busy"},
        _REFUSES | {"reason": "unknown_session"},
    ],
    "Fin": [{"seq": 0}],
    "Cancel": [{"seq": 0}, {"reason": "closed"}, {"reason": "busy"}],
    "Ack": [{"seq": 1}],
    "CAM": [{"dst": 4711}, {"seq": 0}, {"session": [1702, 5]}],
}
"""Fields that contradict each other."""


def _wrong(name: str, value: Json) -> Iterable[Json]:
    """Values that a field must not have."""
    match name:
        case "v":
            return (0, 2, "1", True, 1.0)
        case "src":
            return (0, -1, 2**32, "1702", 1702.0, True, [])
        case "dst":
            return (0, -1, 2**32, "4711", True)
        case "session":
            p, n = value
            parts = ([2**32, n], [-p, n], [str(p), n], [float(p), n], [True, n])
            numbers = ([p, k] for k in (0, -n, LARGE + 1, str(n), float(n), None))
            return ([], [p], [0, 1], [p, n, 1], {"a": 1}, 5, *parts, *numbers)
        case "seq" | "proposal":
            least = (0,) if name == "proposal" else ()
            return (-1, LARGE + 1, 2**64, float(value), str(value), True, *least)
        case "hold_ms" | "lease_ms" | "generation_ms":
            least = (0,) if name == "lease_ms" else ()
            return (-1, LARGE + 1, 2**64, 0.5, 1.0, "1", True, *least)
        case "planned" | "prescribed" | "selected":
            return _wrong_trajectories()
        case "scenario":
            return (5, ["lane_change"], {}, True, "x" * (TEXT + 1))
        case "details":
            deep = ({"a": {"b": [1.5]}}, {"a": [None]}, nested(DEPTH + 1))
            long = ({"a": "x" * (TEXT + 1)}, {"x" * (TEXT + 1): 1})
            return (5, [], "x", {"a": 1.5}, {"a": None}, {"a": [LARGE + 1]}, *deep, *long)
        case "length_mm" | "width_mm":
            low, high = EXTENT_MM
            return (-low, 0, low - 1, high + 1, 0.5, float(low), str(low), True, [low])
        case "station_type":
            return (-1, 256, 5.0, "5", "passengerCar", True, [5])
        case "sigma_mm":
            return (-1, LARGE + 1, 0.5, 500.0, "500", True, [500])
        case "accepted":
            return (0, 1, "true")
        case "reason":
            return ("whim", 5, "", "Abort")
        case "of":
            type_, seq = value["type"], value["seq"]
            forms: tuple[Json, ...] = (
                {},
                [type_, seq],
                {"type": type_},
                {"seq": seq},
                value | {"a": 1},
            )
            seqs = ({"type": type_, "seq": n} for n in (-1, 2**64, 1.0, "1", True, None))
            types = ({"type": name, "seq": seq} for name in ("CAM", type_.lower(), 5, None))
            return (5, *forms, *seqs, *types)
        case "marks":
            many = [[1702, n] for n in range(1, MARKS + 2)]
            sessions = ([1, 0], [0, 1], ["1", 1], [1.0, 1], [2**32, 1], [1, LARGE + 1])
            return (
                5,
                {"a": 1},
                many,
                *([*value, mark] for mark in (*sessions, [1], [1, 1, 1], None)),
            )
    return (0.5, 1.0, "0", True, LARGE + 1, -LARGE - 1, [])


def _wrong_trajectories() -> Iterator[Json]:
    yield from ([], 5, "x", {}, {"t0": 0}, {"points": [_POINT]}, _TRAJECTORY | {"speed": 1})
    for t0 in ("0", 0.5, 1.0, True, LARGE + 1, -LARGE - 1):
        yield {"t0": t0, "points": [_POINT]}
    for points in (list[int](), {"0": _POINT}, 5, [5], _POINT):
        yield {"t0": 0, "points": points}
    wrong = ([0, 0], [0, 0, 0, 0], [0, 0, 0.5], [1.0, 0, 0], [0, "0", 0], [0, 0, True])
    for point in (*wrong, [LARGE + 1, 0, 0], [0, 0, -LARGE - 1], [], {"dt_ms": 0}):
        yield {"t0": 0, "points": [point]}
        yield {"t0": 0, "points": [_POINT, point, _POINT]}


def edge_cases(message: Message) -> Iterator[tuple[str, Message]]:
    """Each unusual value, with fields that make the message valid with it."""
    for name, value in message.items():
        for other in _odd(name, value):
            yield f"{name} {_told(other)}", {name: other}
    if message["type"] == "Advertisement":
        for other in _odd_trajectories():
            yield f"planned {_told(other)}", {"planned": other}
    for name, values in _OPTIONAL.get(message["type"], {}).items():
        for value in values:
            yield f"{name} {value}", {name: value}


def _odd(name: str, value: Json) -> Iterable[Json]:
    match name:
        case "seq" if value:
            return (LARGE,)
        case "planned" | "prescribed" | "selected":
            return _odd_trajectories()
        case "hold_ms":
            return (0, LARGE)
        case "lease_ms":
            return (1, LARGE)
        case "scenario":
            return ("", "x" * TEXT, "\U0001f698" * TEXT)
        case "details":
            names = {"x" * 1000: True, "\u00e4\u0000\u200b": [LARGE, -LARGE], "v": {}}
            names |= dict.fromkeys(TRICKY, 0)
            return ({}, names, {"a": "\U0001f698" * TEXT}, nested(DEPTH))
        case "generation_ms":
            return (0, LARGE)
        case "marks":
            others = [[2**32 - 1, n] for n in range(1, MARKS)]
            return ([*value, *value], [*others, *value], [*value, [1, LARGE], *value])
        case "x_mm" | "y_mm" | "heading_mrad" | "speed_mm_s":
            return (LARGE, -LARGE, -1)
    return ()


def _odd_trajectories() -> Iterator[Json]:
    yield from ({"t0": t0, "points": [_POINT]} for t0 in (-LARGE, LARGE, -1))
    yield {"t0": 0, "points": [[LARGE] * 3, [-LARGE] * 3, [-LARGE] * 3, [0, -1, 1]]}
    yield {"t0": 0, "points": [[n, n, n] for n in range(1000)]}


def named_by_acks() -> Iterator[Json]:
    """Messages that an Ack may name although they are never acknowledged (END-6)."""
    yield from ({"type": type_, "seq": seq} for type_ in MESSAGE_TYPES for seq in (0, LARGE))
