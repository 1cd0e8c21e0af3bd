"""The form of messages in a log: docs/protocol.md, section 2."""

from __future__ import annotations

import copy
import json
import random
from typing import Any

import pytest

from automcm import messages
from automcm_traces import form

TRAJECTORY = {"t0": 0, "points": [[0, 0, 0]]}
COMMON = {"v": 1, "src": 7, "dst": 8, "session": [7, 1], "seq": 1}
MESSAGES: dict[str, dict[str, Any]] = {
    "Advertisement": {**COMMON, "scenario": "", "details": {}},
    "Intention": {**COMMON, "planned": TRAJECTORY},
    "Prescription": {
        **COMMON,
        "proposal": 1,
        "prescribed": TRAJECTORY,
        "hold_ms": 0,
        "lease_ms": 1,
    },
    "Acceptance": {**COMMON, "proposal": 1, "accepted": True, "selected": TRAJECTORY},
    "Fin": dict(COMMON),
    "Cancel": {**COMMON, "reason": "abort"},
    "Ack": {**COMMON, "seq": 0, "of": {"type": "Fin", "seq": 2}},
    "CAM": {
        "v": 1,
        "src": 7,
        "generation_ms": 0,
        "x_mm": -1,
        "y_mm": 0,
        "heading_mrad": 0,
        "speed_mm_s": 0,
        "marks": [[7, 1]],
    },
}
del MESSAGES["Advertisement"]["dst"]


def problems(type_: str, **changed: Any) -> list[tuple[str, str]]:
    message = {**MESSAGES[type_], "type": type_, **changed}
    return list(form.problems({k: v for k, v in message.items() if v is not None}))


@pytest.mark.parametrize("type_", MESSAGES)
def test_each_type_is_taken_as_the_protocol_has_it(type_: str) -> None:
    assert problems(type_) == []


@pytest.mark.parametrize(
    ("type_", "field"), [(type_, field) for type_, m in MESSAGES.items() for field in m]
)
def test_end_5_a_field_that_lacks_is_named(type_: str, field: str) -> None:
    assert [found for found, _ in problems(type_, **{field: None})] == [field]


@pytest.mark.parametrize(
    ("type_", "field"), [(type_, field) for type_, m in MESSAGES.items() for field in m]
)
def test_end_5_a_field_of_another_type_is_named(type_: str, field: str) -> None:
    assert [found for found, _ in problems(type_, **{field: (1,)})] == [field]


@pytest.mark.parametrize(
    ("type_", "changed", "field"),
    [
        ("Fin", {"seq": 0}, "seq"),
        ("Ack", {"seq": 1}, "seq"),
        ("Cancel", {"reason": "closed"}, "seq"),
        ("Cancel", {"reason": "bored"}, "reason"),
        ("Cancel", {"reason": "busy", "seq": 0}, "reason"),
        ("Acceptance", {"accepted": False, "selected": None, "reason": "busy"}, "seq"),
        ("Acceptance", {"accepted": False, "selected": None}, "reason"),
        ("Acceptance", {"accepted": False, "reason": "unsafe"}, "selected"),
        ("Acceptance", {"selected": None}, "selected"),
        ("Acceptance", {"accepted": 1}, "accepted"),
        ("Fin", {"v": True}, "v"),
        ("Fin", {"src": 0}, "src"),
        ("Fin", {"src": 2**32}, "src"),
        ("Fin", {"session": [7, 0]}, "session"),
        ("Fin", {"session": [7]}, "session"),
        ("Fin", {"proposal": 1}, "proposal"),
        ("Advertisement", {"dst": 8}, "dst"),
        ("Intention", {"planned": {"t0": 0, "points": []}}, "planned"),
        ("Intention", {"planned": {"t0": 0, "points": [[0, 0]]}}, "planned"),
        ("Prescription", {"proposal": 0}, "proposal"),
        ("Ack", {"of": {"type": "CAM", "seq": 1}}, "of"),
        ("CAM", {"marks": [[7]]}, "marks"),
        ("CAM", {"session": [7, 1]}, "session"),
    ],
)
def test_end_5_what_the_protocol_excludes_is_named(
    type_: str, changed: dict[str, Any], field: str
) -> None:
    assert [found for found, _ in problems(type_, **changed)] == [field]


def test_a_type_of_nobody_is_named() -> None:
    [(field, problem)] = form.problems({"type": "Hello"})
    assert field == "type" and "'Hello'" in problem


def _values(chance: random.Random) -> Any:
    """A value that may or may not fit where it is put."""
    deep: Any = 1
    for _ in range(chance.choice([1, 30, 31, 32, 33])):
        deep = [deep]
    odd = [0, 1, -1, True, 2**32 - 1, 2**32, 2**53 - 1, 2**53, -(2**53), "", "x", "busy", "closed"]
    odd += ["x" * 65_507, "x" * 65_508, "é", [], {}, [1, 1], [[1, 1]] * 255, [[1, 1]] * 256]
    odd += [{"t0": 0, "points": [[0, 0, 0]]}, {"a": deep}, {"type": "Fin", "seq": 0}, "Fin"]
    return copy.deepcopy(chance.choice(odd))


@pytest.mark.parametrize("type_", MESSAGES)
def test_end_5_it_is_the_form_that_the_reference_takes(type_: str) -> None:
    """The reference's decoder, written on its own, refuses the same."""
    chance = random.Random(type_)
    taken = 0
    for _ in range(600):
        m = copy.deepcopy(MESSAGES[type_]) | {"type": type_}
        for _ in range(chance.choice([1, 1, 2])):
            name = chance.choice([*m, "dst", "reason", "selected", "other"])
            if chance.random() < 0.2:
                m.pop(name, None)
            else:
                m[name] = _values(chance)
        if not isinstance(m.get("type"), str):
            continue
        broadcast = m["type"] not in ("CAM", "Advertisement") and "dst" not in m
        addressed = m["type"] == "Advertisement" and "dst" in m
        if broadcast or addressed:
            continue  # the decoder lets these pass, and the station discards them
        try:
            messages.decode(json.dumps(m).encode())
            good = True
        except messages.MessageError as error:
            if "bytes" in str(error):
                continue
            good = False
        assert form.well_formed(m) == good, m
        assert (form.malformed(m) is None) == good, m
        taken += good
    assert taken > 20
