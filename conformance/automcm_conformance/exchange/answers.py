"""Compares an answer with the expected one, and describes the differences."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from operator import eq
from typing import Any

from pydantic_core import from_json, to_json

from automcm_conformance.adapter.protocol import Answer, has_float, read_answer
from automcm_conformance.exchange.armed_timers import UNKNOWN
from automcm_conformance.exchange.wire import Expected
from automcm_spec.vocabulary.messages import same

Json = Any
_FIELDS = Answer.model_fields.keys()
_NEEDED = {name for name, field in Answer.model_fields.items() if field.is_required()}
_TRUTHS = ("Acceptance", "Advertisement")
"""Messages that may hold a truth value."""
Problem = tuple[str, str]
"""The wrong part of an answer (``messages``, ``indications``, ``deadline``, ``phase``, ``cams``),
and a sentence about it."""


def differences(expected: Expected, line: bytes) -> list[Problem]:
    """The differences from the expected answer, as (part, sentence); empty if there are none.

    Raises ProtocolError for a line that is not an answer.
    """
    if _as_expected(expected, line):
        return []
    answer = read_answer(line)
    problems: list[Problem] = []
    if answer.messages or expected.messages:
        problems += _messages(expected, answer.messages)
    if answer.indications or expected.indications:
        problems += _told(expected.indications, answer.indications)
    if answer.phase not in (None, expected.phase):
        problems.append(("phase", f"phase: expected {expected.phase}, got {answer.phase}"))
    if expected.deadline not in (UNKNOWN, answer.deadline):
        text = f"deadline: expected {expected.deadline}, got {answer.deadline}"
        problems.append(("deadline", text))
    for cam in answer.cams if expected.marks else ():
        problems += _marks(expected, cam)
    return problems


def _as_expected(expected: Expected, line: bytes) -> bool:
    """Whether the answer is exactly as expected. Nearly all are, and their form is then right as
    well. Python's 1 equals true and 1.0, so answers with truth values are compared by type too."""
    try:
        found = from_json(line)
    except ValueError:
        return False
    if type(found) is not dict or not found.keys() <= _FIELDS:
        return False
    deadline = found.get("deadline", UNKNOWN)
    if type(deadline) is not type(expected.deadline) or deadline != expected.deadline:
        return False
    if found.get("phase", expected.phase) != expected.phase:
        return False
    messages, indications, cams = (
        found.get(name, []) for name in ("messages", "indications", "cams")
    )
    if messages == indications == cams == []:
        return not expected.messages and not expected.indications and found.keys() >= _NEEDED
    if has_float(line) or type(indications) is not list or type(cams) is not list:
        return False
    truths = b"true" in line or b"false" in line
    truths = truths or any(m["type"] in _TRUTHS for m in expected.messages)
    alike = same if truths else eq
    return (
        alike(expected.messages, messages)
        and len(indications) == len(expected.indications)
        and all(map(partial(_holds, alike), indications, expected.indications))
        and all(_is_cam(cam) and _marked(expected, cam) for cam in cams)
        and found.keys() >= _NEEDED
    )


def _holds(alike: Callable[[Json, Json], bool], found: Json, wanted: dict[str, Json]) -> bool:
    """Whether an indication has the wanted fields; it may have others."""
    if type(found) is not dict:
        return False
    return all(name in found and alike(value, found[name]) for name, value in wanted.items())


def _is_cam(cam: Json) -> bool:
    return type(cam) is dict and cam.get("type") == "CAM" and type(cam.get("generation_ms")) is int


def _marked(expected: Expected, cam: dict[str, Json]) -> bool:
    marks = cam.get("marks")
    return not expected.marks or any(are_marks(wanted, marks) for wanted in expected.marks)


def _messages(expected: Expected, found: list[Json]) -> list[Problem]:
    left = list(found)
    missing = []
    problems: list[Problem] = []
    for message in expected.messages:
        match = next((m for m in left if _fits(message, m)), None)
        if match is None:
            missing.append(message)
        else:
            left.remove(match)
            problems += _settle(message, match, expected)
    for message, other in zip(missing, left, strict=False):
        problems.append(("messages", first_difference(message, other)))
    for message in missing[len(left) :]:
        problems.append(("messages", f"not sent: {message['type']} {to_json(message).decode()}"))
    for message in left[len(missing) :]:
        problems.append(("messages", unexpected_message(message)))
    return problems


def unexpected_message(message: Json) -> str:
    """The text about a message that the station should not have sent."""
    return f"no rule requires this message: {to_json(message).decode()}"


def _fits(wanted: dict[str, Json], found: Json) -> bool:
    if wanted["seq"] is None or wanted["session"][1] is None:
        if type(found) is not dict or wanted.keys() != found.keys():
            return False
        return all(
            same(value, found[name])
            or (name == "seq" and value is None and type(found[name]) is int)
            or (name == "session" and value[1] is None and _own(value, found[name]))
            for name, value in wanted.items()
        )
    return same(wanted, found)


def _own(wanted: Json, found: Json) -> bool:
    return (
        type(found) is list
        and len(found) == 2
        and found[0] == wanted[0]
        and type(found[1]) is int
        and found[1] > 0
    )


def _settle(wanted: dict[str, Json], found: dict[str, Json], expected: Expected) -> list[Problem]:
    """Takes over a value that the station was free to choose, and checks that it was. Other values
    are not taken over: a replay expects the values expected here."""
    problems = []
    if wanted["session"][1] is None:
        number = found["session"][1]
        if number <= expected.above:
            text = f"session: expected a number above {expected.above}, got {number}"
            problems.append(("messages", f"{wanted['type']}.{text}"))
        else:
            wanted["session"] = found["session"]
    if wanted["seq"] is None:
        if found["seq"] in expected.fresh:
            expected.fresh.remove(found["seq"])
            wanted["seq"] = found["seq"]
        else:
            text = f"seq: expected one of {expected.fresh}, got {found['seq']}"
            problems.append(("messages", f"{wanted['type']}.{text}"))
    return problems


def first_difference(wanted: dict[str, Json], found: Json) -> str:
    """The first difference between two messages, in one line."""
    if type(found) is not dict:
        return f"expected a message (an object), got {found!r}"
    if wanted["type"] != found.get("type"):
        return f"expected {wanted['type']}, got {to_json(found).decode()}"
    for name in [*wanted, *found]:
        if name not in found:
            return f"{wanted['type']}.{name}: missing"
        if name not in wanted:
            return f"{wanted['type']}.{name}: unknown field"
        free = wanted[name] is None or (name == "session" and wanted[name][1] is None)
        if not free and not same(wanted[name], found[name]):
            value, other = (to_json(m[name]).decode() for m in (wanted, found))
            return f"{wanted['type']}.{name}: expected {value}, got {other}"
    return "a message that differs"


def _told(wanted: list[dict[str, Json]], found: list[dict[str, Json]]) -> list[Problem]:
    names = [i["name"] for i in wanted], [i["name"] for i in found]
    if names[0] != names[1]:
        text = f"indications: expected {names[0]}, got {names[1]}"
        return [("indications", text)]
    for one, other in zip(wanted, found, strict=True):
        for name, value in one.items():
            if name not in other or not same(value, other[name]):
                got = to_json(other.get(name)).decode() if name in other else "nothing"
                text = f"{one['name']}.{name}: expected {to_json(value).decode()}, got {got}"
                return [("indications", text)]
    return []


def _marks(expected: Expected, cam: dict[str, Json]) -> list[Problem]:
    marks = cam.get("marks")
    if any(are_marks(wanted, marks) for wanted in expected.marks):
        return []
    return [("cams", f"CAM.marks: expected {expected.marks[0]}, got {marks}")]


def are_marks(wanted: list[Json], found: Json) -> bool:
    """Whether these are the marks of a CAM, in any order (ACT-5)."""
    return (
        type(found) is list and len(found) == len(wanted) and all(mark in found for mark in wanted)
    )
