"""Compares an answer with the expected one, and describes the differences."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

from pydantic_core import to_json

from automcm_conformance.adapter.protocol import read_answer
from automcm_conformance.exchange.armed_timers import UNKNOWN
from automcm_conformance.exchange.wire import Required
from automcm_spec.vocabulary.messages import same

Json = Any
MARKS = "CAM.marks"
"""The kind of a problem with the marks of a CAM."""
BACK_OFF = "back-off"
"""The kind of a problem with the length of a back-off, which the station draws (END-7)."""


class Problem(NamedTuple):
    """One difference from the expected answer."""

    part: str
    """``messages``, ``indications``, ``deadline``, ``phase`` or ``cams``."""
    text: str
    kind: str = ""
    """What differs, without values: equal for equal causes. ``Ack.of.seq`` is a field."""


def differences(expected: Required, line: bytes) -> list[Problem]:
    """The differences from the expected answer; empty if there are none.

    Raises ProtocolError for a line that is not an answer.
    """
    answer = read_answer(line)
    problems: list[Problem] = []
    truths = _has_truths(line)
    if not _alike(expected.messages, answer.messages, truths):
        problems += _messages(expected, answer.messages)
    if not _alike(expected.indications, answer.indications, truths):
        problems += _told(expected.indications, answer.indications)
    if answer.phase not in (None, expected.phase):
        text = f"phase: expected {expected.phase}, got {answer.phase}"
        problems.append(Problem("phase", text, "phase"))
    if expected.deadline not in (UNKNOWN, answer.deadline):
        timer = f" ({expected.timer})" if expected.timer else ""
        due, found = (to_json(ms).decode() for ms in (expected.deadline, answer.deadline))
        text = f"deadline: expected {due}{timer}, got {found}"
        problems.append(Problem("deadline", text, f"deadline of {expected.timer or 'no timer'}"))
    for cam in answer.cams if expected.marks else ():
        marks, due = cam.get("marks"), cam["generation_ms"]
        wanted = _marks_at(expected, due)
        if (truths or marks not in wanted) and not any(are_marks(w, marks) for w in wanted):
            text = f"CAM.marks: expected {wanted[0]} at {due} ms, got {marks}"
            problems.append(Problem("cams", text, MARKS))
    return problems


def _has_truths(text: bytes) -> bool:
    return b"true" in text or b"false" in text


def _alike(wanted: list[Json], found: list[Json], truths: bool) -> bool:
    """Whether the lists are the same, and no null stands for what the station chooses. Only truth
    values, which Python takes for numbers, need ``same``; ``truths``: ``found`` may have some."""
    if not wanted or wanted != found:
        return wanted == found
    text = to_json(wanted)
    return b"null" not in text and (not (truths or _has_truths(text)) or same(wanted, found))


def _marks_at(expected: Required, due: int) -> Sequence[Json]:
    """The marks that a CAM may have that is due then: at the time of a change, or if a timer fires
    late, either (ACT-5)."""
    if len(expected.marks_since) != len(expected.marks):
        return expected.marks  # of a replay file without times
    begun = zip(expected.marks, expected.marks_since, strict=True)
    return [marks for marks, since in begun if since <= due]


def _messages(expected: Required, found: list[Json]) -> list[Problem]:
    left = list(found)
    missing = []
    problems: list[Problem] = []
    least = latest = -1
    for n, message in enumerate(expected.messages):
        if n in expected.begins:
            least = latest
        match = next((m for m in left if _fits(message, m)), None)
        if match is None:
            missing.append(message)
        else:
            left.remove(match)
            problems += _settle(message, match, expected)
            latest = max(latest, place := found.index(match))
            if place < least:
                text = f"sent before the messages of an earlier expiry: {to_json(match).decode()}"
                problems.append(Problem("messages", text, "order of messages"))
    for message, other in zip(missing, left, strict=False):
        problems.append(first_difference(message, other))
    unsent = missing[len(left) :]
    for type_, n in Counter(message["type"] for message in unsent).items():
        first = next(message for message in unsent if message["type"] == type_)
        texts = [f"not sent: {type_} {to_json(first).decode()}"]
        texts += [f"not sent: {n - 1} more of type {type_}"] * (n > 1)
        problems += [Problem("messages", text, f"{type_} missing") for text in texts]
    for message in left[len(missing) :]:
        about = message.get("type") if type(message) is dict else "no message"
        kind = f"{about} too many"
        problems.append(Problem("messages", unexpected_message(message), kind))
    return problems


def unexpected_message(message: Json) -> str:
    """The text about a message that the station should not have sent."""
    return f"no rule requires this message: {to_json(message).decode()}"


def _fits(wanted: dict[str, Json], found: Json) -> bool:
    if wanted["seq"] is not None and wanted["session"][1] is not None:
        return same(wanted, found)
    return (
        type(found) is dict
        and wanted.keys() == found.keys()
        and all(_holds(name, value, found[name]) for name, value in wanted.items())
    )


def _holds(name: str, wanted: Json, found: Json) -> bool:
    """Whether a field has the wanted value; one that the station chooses must have its form."""
    if name == "seq" and wanted is None:
        return type(found) is int
    if name == "session" and wanted[1] is None:
        match found:
            case [station, number]:
                return station == wanted[0] and type(number) is int and number > 0
        return False
    return same(wanted, found)


def _settle(wanted: dict[str, Json], found: dict[str, Json], expected: Required) -> list[Problem]:
    """Takes over a value that the station was free to choose, and checks that it was. Other values
    are not taken over: a replay expects the values expected here."""
    type_, problems = wanted["type"], []
    if wanted["session"][1] is None:
        number = found["session"][1]
        if number > expected.above:
            wanted["session"] = found["session"]
        else:
            problems.append(_other(f"{type_}.session", f"a number above {expected.above}", number))
    if wanted["seq"] is None:
        if found["seq"] in expected.fresh:
            expected.fresh.remove(found["seq"])
            wanted["seq"] = found["seq"]
        else:
            problems.append(_other(f"{type_}.seq", f"one of {expected.fresh}", found["seq"]))
    return problems


def _other(field: str, wanted: str, found: object) -> Problem:
    return Problem("messages", f"{field}: expected {wanted}, got {found}", field)


def first_difference(wanted: dict[str, Json], found: Json) -> Problem:
    """The first difference between two messages."""
    if type(found) is not dict:
        text = f"expected a message (an object), got {found!r}"
        return Problem("messages", text, "no message")
    type_ = wanted["type"]
    if type_ != found.get("type"):
        text = f"expected {type_}, got {to_json(found).decode()}"
        return Problem("messages", text, f"{type_} missing")
    return _in_object(type_, wanted, found) or Problem("messages", "a message that differs")


def _in_object(path: str, wanted: dict[str, Json], found: dict[str, Json]) -> Problem | None:
    """The first difference between two objects; ``path`` leads to them."""
    for name in [*wanted, *found]:
        here = f"{path}.{name}"
        if name not in found:
            return Problem("messages", f"{here}: missing", here)
        if name not in wanted:
            return Problem("messages", f"{here}: unknown field", here)
        if _holds(name, wanted[name], found[name]):
            continue
        if type(wanted[name]) is dict and type(found[name]) is dict:
            inner = _in_object(here, wanted[name], found[name])
            if inner is not None:
                return inner
        value, other = (to_json(m[name]).decode() for m in (wanted, found))
        if name in ("seq", "session"):
            value = value.replace("null", "a number")
        return _other(here, value, other)
    return None


def _told(wanted: list[dict[str, Json]], found: list[dict[str, Json]]) -> list[Problem]:
    names = [i["name"] for i in wanted], [i["name"] for i in found]
    if names[0] != names[1]:
        said, heard = (", ".join(each) or "none" for each in names)
        text = f"indications: expected {said}, got {heard}"
        return [Problem("indications", text, text)]
    for one, other in zip(wanted, found, strict=True):
        for name, value in one.items():
            if name not in other or not same(value, other[name]):
                got = to_json(other.get(name)).decode() if name in other else "nothing"
                text = f"{one['name']}.{name}: expected {to_json(value).decode()}, got {got}"
                return [Problem("indications", text, f"{one['name']}.{name}")]
    return []


def are_marks(wanted: list[Json], found: Json) -> bool:
    """Whether these are the marks of a CAM, in any order (ACT-5)."""
    if type(found) is not list or len(found) != len(wanted):
        return False
    return all(any(same(mark, other) for other in found) for mark in wanted)
