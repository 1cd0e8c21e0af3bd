"""Logged events as short text that is safe to print anywhere."""

from __future__ import annotations

import base64
import unicodedata
from collections.abc import Iterator, Mapping
from typing import Any, Literal, NamedTuple, TypeVar

from rich.cells import cell_len, set_cell_size

from automcm_spec.log_format.log import (
    ApplicationCommand,
    ApplicationIndication,
    Event,
    ForgetTimer,
    MessageKey,
    MessageTimer,
    Receive,
    Restart,
    Send,
    Timer,
    TimerArm,
    TimerEnd,
)
from automcm_spec.vocabulary.messages import Fields, session_in

Kind = Literal["send", "receive", "timer", "command", "indication", "restart", "note", "phase"]

Name = TypeVar("Name", int, str)
DAY_MS = 86_400_000
_LONGEST = 300
"""The maximum length in characters. No event needs more; some messages contain megabytes."""
_TURNS = {"R", "AL", "AN", "RLE", "RLO", "RLI", "LRE", "LRO", "LRI", "PDF", "PDI", "FSI"}


def safe(text: str) -> str:
    """``text``, truncated, with escapes for characters that move the cursor or change the text
    direction."""
    text = text[:_LONGEST]
    if text.isascii() and text.isprintable():
        return text
    harmful = {c for c in text if not c.isprintable() or unicodedata.bidirectional(c) in _TURNS}
    return "".join(ascii(c)[1:-1] if c in harmful else c for c in text)


def fitted(text: str, width: int) -> str:
    """``text`` padded or cut to exactly ``width`` terminal columns; cut text ends with two dots."""
    size = len(text) if text.isascii() else cell_len(text)
    if size <= width:
        return text + " " * (width - size)
    return set_cell_size(text, width - 2) + ".."


class Word(NamedTuple):
    """A word of a summary, and what may stand for it, one after the other, where there is little
    room. Words of a lower rank are shortened first."""

    text: str
    shorter: tuple[str, ...] = ()
    rank: int = 0


def _id(text: str) -> Word:
    """A word that can be left out: a station, a proposal, a duration."""
    return Word(text, ("",), 1)


def summary(event: Event) -> str:
    """A summary of an event, the most important part first.

    Examples: ``Intention ->1001 1001/1#1``, ``<- Intention 2002``, ``expire decide``. ``1001/1`` is
    a session, ``#1`` a seq, ``p1`` a proposal.
    """
    return safe(" ".join(word.text for word in words(event)))


def words(event: Event) -> list[Word]:
    """The words of the summary. Where there is little room, the session goes first, then stations,
    proposals and durations, then the seq of an acknowledged or repeated message."""
    match event:
        case Send(message=m):
            to = "all" if m.get("dst") is None else plain(m["dst"])
            return [Word(str(m["type"])), _id(f"->{to}"), *_content(m)]
        case Receive(rejected=str(reason)):
            return [Word("<- rejected"), _id(_sender(event)), Word(reason)]
        case Receive(message=None, raw=raw):
            size = len(base64.b64decode(raw or ""))
            return [*_kept(f"<- no message, {size} bytes"), _id(_sender(event))]
        case Receive(message=m) if m is not None:
            src = plain(m.get("src", "?"))
            return [Word(f"<- {m['type']}"), _id(src), *_content(m)]
        case TimerArm(timer=timer):
            return [Word("arm"), *_timer(timer), _id(f"+{event.deadline - event.t_ms}")]
        case TimerEnd(timer=timer):
            return [Word(event.op), *_timer(timer)]
        case ApplicationCommand(command=command):
            return [*_kept(f"command {command.name}"), *_fields(command.model_extra or {})]
        case ApplicationIndication(indication=indication):
            return [*_kept(f"told {indication.name}"), *_fields(indication.model_extra or {})]
        case Restart():
            return [Word("RESTART")]
    return []


def _sender(event: Receive) -> str:
    """The sender according to ``tx``."""
    return event.tx.split(":")[0] if event.tx else "somebody"


def _kept(text: str) -> list[Word]:
    return [Word(word) for word in text.split(" ")]


def starts(first_ms: Mapping[Name, int]) -> dict[Name, int]:
    """By log, the time that counts as the start: that of the first event in all logs. ``first_ms``
    has that of the first event in each, by station or by file.

    A clock that is more than a day ahead has another origin, so its own first event counts.
    """
    earliest = min(first_ms.values(), default=0)
    return {log: t if t - earliest > DAY_MS else earliest for log, t in first_ms.items()}


def session_of(event: Event) -> tuple[int, int] | None:
    """The session an event names; None if it names none."""
    value: Any = None
    match event:
        case Send(message=m) | Receive(message=m) if m is not None:
            value = m.get("session")
        case TimerArm(timer=timer) | TimerEnd(timer=timer):
            about = getattr(timer, "message", None)
            value = list(about.session) if about is not None else None
        case ApplicationCommand(command=named) | ApplicationIndication(indication=named):
            value = (named.model_extra or {}).get("session")
    return session_in(value)


def plain(value: object) -> str:
    """A field value as text; it may have any type, because a log may contain malformed messages."""
    if (session := session_in(value)) is not None:
        return f"{session[0]}/{session[1]}"
    if isinstance(value, (dict, list)):
        return "{..}" if isinstance(value, dict) else "[..]"
    return str(value)


def _content(m: Fields) -> Iterator[Word]:
    """The fields that distinguish this message from others of its type."""
    if "accepted" in m:
        yield Word("accepts" if m["accepted"] is True else "refuses")
    if "reason" in m:
        yield Word(f"({plain(m['reason'])})")
    if "proposal" in m:
        yield _id(f"p{plain(m['proposal'])}")
    of = m.get("of")
    if isinstance(of, dict):
        acknowledged = plain(of.get("type", "?"))
        yield Word("of")
        yield Word(f"{acknowledged}#{plain(of.get('seq', '?'))}", (acknowledged,), 2)
    if m["type"] == "CAM":
        marks = m.get("marks")
        yield from (Word(plain(mark)) for mark in marks) if isinstance(marks, list) else ()
    if "session" in m:
        seq = f"#{plain(m.get('seq', '?'))}"
        yield Word(f"{plain(m['session'])}{seq}", (seq, ""))


def _timer(timer: Timer) -> Iterator[Word]:
    yield Word(timer.name)
    match timer:
        case MessageTimer(message=MessageKey() as m):
            yield Word(f"{m.type}#{m.seq}", (m.type,), 2)
            yield _id(f"->{m.to or 'all'}")
        case ForgetTimer(station=int(station)):
            yield Word(str(station))


_SHOWN_FIELDS = ("reason", "target", "station", "proposal", "session")


def _fields(fields: Fields) -> Iterator[Word]:
    for name in _SHOWN_FIELDS:
        if name in fields:
            text = plain(fields[name])
            if name == "reason":
                yield Word(f"({text})")
            else:
                yield _id(f"p{text}" if name == "proposal" else text)
