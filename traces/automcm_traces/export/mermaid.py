"""Writes logs as a Mermaid sequence diagram."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from automcm_spec.support.bad_input import printable
from automcm_traces.explain.log_table import Row
from automcm_traces.format.event_text import summary
from automcm_traces.format.log import (
    ApplicationCommand,
    ApplicationIndication,
    Event,
    Receive,
    Restart,
    Send,
)

MESSAGES = 400
"""The maximum number of arrows; browsers draw no more."""


def diagram(rows: Iterable[Row], stations: Sequence[int], most: int = MESSAGES) -> Iterator[str]:
    """The lines of a diagram: messages as arrows, commands and phases as notes.

    ``rows`` are those of ``log_table.Logs``. A received message is an arrow at its reception. A
    message that was lost, or that is not in the other log, ends in a cross. CAMs and timers are
    left out. After ``most`` messages, a note states the number of the remaining ones.
    """
    kept = list(rows)
    sent = {row.event.tx for row in kept if isinstance(row.event, Send)}
    taken = {row.event.tx for row in kept if isinstance(row.event, Receive)}
    known = set(stations)
    known |= {s for row in kept if (s := _sender(row.event)) is not None}
    known |= {s for row in kept if (s := _addressee(row.event)) is not None}
    yield "sequenceDiagram"
    yield from (f"  participant S{station} as {station}" for station in sorted(known))
    phase: dict[int, str] = {}
    arrows = left_out = 0
    for row in kept:
        arrow = _arrow(row, sent, taken)
        if arrow:
            arrows += 1
            left_out += arrows > most
        if arrows > most:
            continue
        if arrow:
            yield f"  {arrow}"
        elif isinstance(row.event, ApplicationCommand | ApplicationIndication | Restart):
            yield f"  Note over S{row.station}: {_plain(summary(row.event))}"
        now = row.event.phase if row.event is not None else None
        if now is not None and now != phase.get(row.station, "STANDALONE"):
            yield f"  Note over S{row.station}: = {_plain(now)}"
        if now is not None:
            phase[row.station] = now
    if left_out:
        first, last = min(known), max(known)
        yield f"  Note over S{first},S{last}: {left_out} more messages are not shown"


def _arrow(row: Row, sent: set[str], taken: set[str | None]) -> str:
    """A message as an arrow; empty for other events, and for a message whose reception follows
    later."""
    event, me = row.event, f"S{row.station}"
    if not isinstance(event, Send | Receive) or event.message is None:
        return ""
    if event.message["type"] == "CAM":
        return ""
    words = summary(event).split(" ")
    if isinstance(event, Receive):
        sender = _sender(event)
        if sender is None:
            return f"Note over {me}: {_plain(summary(event))}"
        arrow = "->>" if event.tx in sent or event.tx is None else "-->>"
        notes = [note for note in row.notes if not note.startswith("for ")]
        return f"S{sender}{arrow}{me}: {_plain(' '.join([*notes, words[1], *words[3:]]))}"
    if event.tx in taken:
        return ""
    label = _plain(" ".join([*row.notes, words[0], *words[2:]]))
    to = _addressee(event)
    if to is None:
        return f"Note over {me}: {label} to all"
    return f"{me}-x S{to}: {label}"


def _sender(event: Event | None) -> int | None:
    if not isinstance(event, Receive) or event.message is None:
        return None
    if event.message["type"] == "CAM":
        return None
    src = event.message.get("src")
    return src if type(src) is int and src >= 0 else None


def _addressee(event: Event | None) -> int | None:
    if not isinstance(event, Send) or event.message["type"] == "CAM":
        return None
    dst = event.message.get("dst")
    return dst if type(dst) is int and dst > 0 else None


def _plain(text: str) -> str:
    """Text without Mermaid syntax: a semicolon ends a line, a hash begins a code."""
    text = printable(text)
    codes = {"#": "#35;", ";": "#59;", "<": "#lt;", ">": "#gt;", "%": "#37;", "&": "#38;"}
    return "".join(codes.get(c, c) for c in text)
