"""Writes logs as a Mermaid sequence diagram."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from automcm_spec.log_format.event_text import summary
from automcm_spec.log_format.log import ApplicationCommand, ApplicationIndication, Receive, Restart
from automcm_spec.support.bad_input import printable
from automcm_traces.explain.log_table import TableRow, folds
from automcm_traces.system.fates import ANYONE, Arrow, Fate

MESSAGES = 400
"""The maximum number of arrows; browsers draw no more."""
HEADS: dict[Fate, str] = {
    "delivered": "->>",
    "duplicated": "->>",
    "lost": "-x ",
    "in_flight": "-)",
    "unobserved": "--)",
    "sender_unobserved": "-->>",
    "forged": "-->>",
    "overheard": "-->>",
    "rejected": "--x ",
}
SAID = ("duplicated", "in_flight", "forged", "overheard")
"""The fates that the text names, because the head does not show them."""


def diagram(
    rows: Iterable[TableRow], stations: Sequence[int], most: int = MESSAGES, unfold: bool = False
) -> Iterator[str]:
    """The lines of a diagram: messages as arrows, commands and phases as notes.

    ``rows`` are those of ``log_table.Logs``. A received message is an arrow at its reception. A
    lost one ends in a cross, a rejected one is also dotted; another dotted one is not in the log of
    one of its stations. CAMs and timers are left out. Copies are one arrow, unless ``unfold``.
    After ``most`` arrows, a note states the number of the remaining messages.
    """
    kept = [row for row in rows if row.event is None or row.phase or not row.event.is_cam]
    known = {*stations, *(s for row in kept for a in row.arrows for s in (a.source, a.to))}
    known -= {ANYONE}
    yield "sequenceDiagram"
    yield from (f"  participant S{station} as {station}" for station in sorted(known))
    drawn = left_out = 0
    for fold in folds(kept, unfold):
        row, room = fold.first, max(0, most - drawn)
        drawn += len(row.arrows)
        left_out += fold.times * len(row.arrows[room:])
        yield from (f"  {_arrow(row, arrow, fold.mark)}" for arrow in row.arrows[:room])
        if drawn > most:
            continue
        if isinstance(row.event, ApplicationCommand | ApplicationIndication | Restart):
            yield f"  Note over S{row.station}: {_plain(summary(row.event))}"
        if row.phase:
            yield f"  Note over S{row.station}: = {_plain(row.phase)}"
    if left_out:
        first, last = min(known), max(known)
        yield f"  Note over S{first},S{last}: {left_out} more messages are not shown"


def _arrow(row: TableRow, arrow: Arrow, mark: str) -> str:
    """A message as an arrow, or as a note if one of its ends is no single station."""
    assert row.event is not None, "a row with an arrow has an event"
    fate = "".join([f" {mark}" * bool(mark), f" ({arrow.word})" * (arrow.fate in SAID)])
    if ANYONE in (arrow.source, arrow.to):
        return f"Note over S{row.station}: {_plain(summary(row.event))}{fate}"
    words = summary(row.event).split(" ")
    label = [words[1], *words[3:]] if isinstance(row.event, Receive) else [words[0], *words[2:]]
    return f"S{arrow.source}{HEADS[arrow.fate]}S{arrow.to}: {_plain(' '.join(label))}{fate}"


def _plain(text: str) -> str:
    """Text without Mermaid syntax: a semicolon ends a line, a hash begins a code."""
    text = printable(text)
    codes = {"#": "#35;", ";": "#59;", "<": "#lt;", ">": "#gt;", "%": "#37;", "&": "#38;"}
    return "".join(codes.get(c, c) for c in text)
