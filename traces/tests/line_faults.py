"""Faults in the form of a log, each in one field of one line, for tests."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

Json = Any
Path_ = tuple[str, ...]


class Fault(NamedTuple):
    where: Path_
    change: Callable[[Json, str], None]
    """Makes the fault in the object that has the field of this name."""
    extra: bool = False


def null(within: Json, name: str) -> None:
    within[name] = None


def half(within: Json, name: str) -> None:
    within[name] += 0.5


def text(within: Json, name: str) -> None:
    within[name] = str(within[name])


def removed(within: Json, name: str) -> None:
    del within[name]


def odd(within: Json, name: str) -> None:
    within[name] = "tea"


def turned(within: Json, name: str) -> None:
    within[name] = [*reversed(within[name])]


def added(within: Json, name: str) -> None:
    within[name] = -71


ALWAYS = ("seq", "t_ms", "run", "station", "complete", "tx", "timer")
TAGS = (("rec",), ("ev",), ("op",), ("timer", "name"))
"""The fields that say which others a line has: without a right one, the others are not checked."""
CLOSED = ("implementation", "spec", "parameters", "timer")
"""The objects of a log in which other fields than its own are refused."""

FREE = (("message",), ("indication",), ("command",), ("planned",))
"""The objects with content of the application."""


def faults(value: Json, within: Path_ = ()) -> Iterator[Fault]:
    """The faults that can be made in a line. In a message only those that break the log."""
    if not within or within[0] in CLOSED:
        yield Fault((*within, "rssi"), added, extra=True)
    for name, inner in value.items():
        where = (*within, name)
        if within[:1] == ("message",) and name in ("type", "src", "proposal", "target"):
            continue
        if where in TAGS:
            continue
        yield Fault(where, null)
        if isinstance(inner, int) and not isinstance(inner, bool):
            yield Fault(where, half)
            if within[:1] not in FREE:
                yield Fault(where, text)
        if name in ALWAYS and not within and (name, value.get("ev")) != ("tx", "receive"):
            yield Fault(where, removed)
        if name == "tx":
            yield Fault(where, odd)
        if name == "complete" and len(inner) > 1:
            yield Fault(where, turned)
        if isinstance(inner, dict):
            yield from faults(inner, where)


def apart(one: Fault, other: Fault) -> bool:
    """Whether two faults are independent."""
    shorter = min(len(one.where), len(other.where))
    return one.where[:shorter] != other.where[:shorter]


def with_faults(line: Json, chosen: list[Fault]) -> Json:
    line = copy.deepcopy(line)
    for fault in chosen:
        within = line
        for name in fault.where[:-1]:
            within = within[name]
        fault.change(within, fault.where[-1])
    return line
