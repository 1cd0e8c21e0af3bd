"""Messages, commands and CAMs of the specification as on the wire (docs/messages.md).

The specification keeps neither ids nor content. ``Names`` gives the ids, and a function the value
of each field that is content: ``scenario``, ``details``, ``planned``, ``prescribed``, ``selected``,
``hold_ms``, ``lease_ms``, and also ``reason`` and ``of``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Protocol

from automcm_spec.vocabulary.station import Command, Message, Session

Json = Any
Content = Callable[[str], Json]
_CONTENT = {
    "Advertisement": ("scenario", "details"),
    "Intention": ("planned",),
    "Prescription": ("prescribed", "hold_ms", "lease_ms"),
    "Cancel": ("reason",),
    "Ack": ("of",),
}
_GIVEN = {
    "request": ("scenario", "details"),
    "prescribe": ("prescribed", "hold_ms", "lease_ms"),
    "accept": ("selected",),
}


class Names(Protocol):
    """The real names of stations and sessions."""

    def station(self, station: int) -> int:
        """The id of a station."""

    def session(self, session: Session) -> list[int]:
        """A session, as in a message."""


def message(names: Names, m: Message, seq: int | None, content: Content) -> dict[str, Json]:
    """A message with this seq."""
    out: dict[str, Json] = {"v": 1, "src": names.station(m.src)}
    if m.dst:
        out["dst"] = names.station(m.dst)
    out["session"], out["seq"], out["type"] = names.session(m.session), seq, m.type
    fields = _CONTENT.get(m.type, ())
    if m.type in ("Prescription", "Acceptance"):
        out["proposal"] = m.proposal
    if m.type == "Acceptance":
        out["accepted"] = m.accepted
        fields = ("selected",) if m.accepted else ("reason",)
    for name in fields:
        out[name] = content(name)
    return out


def command(names: Names, c: Command, content: Content) -> dict[str, Json]:
    """A command of the application."""
    out: dict[str, Json] = {"name": c.name}
    if c.name != "request":
        out["session"] = names.session(c.session)
    if c.name in ("prescribe", "accept", "refuse"):
        out["proposal"] = c.proposal
    if c.name == "prescribe":
        out["target"] = names.station(c.target)
    return out | {name: content(name) for name in _GIVEN.get(c.name, ())}


def cam(
    names: Names, src: int, marks: Iterable[Session], generation_ms: int, x_mm: int = 0
) -> dict[str, Json]:
    """A CAM."""
    out: dict[str, Json] = {"v": 1, "type": "CAM", "src": names.station(src)}
    out |= {"generation_ms": generation_ms, "x_mm": x_mm, "y_mm": 0, "heading_mrad": 0}
    return out | {"speed_mm_s": 8333, "marks": sorted(map(names.session, marks))}
