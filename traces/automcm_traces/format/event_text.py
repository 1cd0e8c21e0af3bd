"""Logged events as short text that is safe to print anywhere."""

from __future__ import annotations

import base64
import unicodedata
from typing import Any, Literal

from rich.cells import cell_len, set_cell_size

from automcm_spec.vocabulary.messages import Fields
from automcm_traces.format.log import (
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

Kind = Literal["send", "receive", "timer", "command", "indication", "restart", "note", "phase"]

_LONGEST = 300
"""The maximum length in characters. No event needs more; some messages contain megabytes."""
_TURNS = {"R", "AL", "AN", "RLE", "RLO", "RLI", "LRE", "LRO", "LRI", "PDF", "PDI", "FSI"}


def safe(text: str) -> str:
    """``text``, truncated, with escapes for characters that move the cursor or change the text
    direction."""
    text = text[:_LONGEST]
    if text.isascii() and text.isprintable():
        return text
    return "".join(c if _harmless(c) else ascii(c)[1:-1] for c in text)


def _harmless(c: str) -> bool:
    return c.isprintable() and unicodedata.bidirectional(c) not in _TURNS


def fitted(text: str, width: int) -> str:
    """``text`` padded or cut to exactly ``width`` terminal columns; cut text ends with two dots."""
    size = len(text) if text.isascii() else cell_len(text)
    if size <= width:
        return text + " " * (width - size)
    return set_cell_size(text, width - 2) + ".."


def kind(event: Event) -> Kind:
    """The kind of an event, for example to choose a colour."""
    return event.ev


def summary(event: Event) -> str:
    """A summary of an event, the most important part first.

    Examples: ``Intention ->1001 1001/1#1``, ``<- Intention 2002``, ``expire decide``. ``1001/1`` is
    a session, ``#1`` a seq, ``p1`` a proposal.
    """
    match event:
        case Send(message=m):
            to = "all" if m.get("dst") is None else _plain(m["dst"])
            return safe(f"{m['type']} ->{to}{_content(m)}")
        case Receive(message=None, raw=raw):
            size = len(base64.b64decode(raw or ""))
            sender = event.tx.split(":")[0] if event.tx else "somebody"
            return f"<- no message, {size} bytes {sender}"
        case Receive(message=m) if m is not None:
            return safe(f"<- {m['type']} {_plain(m.get('src', '?'))}{_content(m)}")
        case TimerArm(timer=timer):
            name = _timer(timer)
            return safe(f"arm {name} +{event.deadline - event.t_ms}")
        case TimerEnd(timer=timer):
            return safe(f"{event.op} {_timer(timer)}")
        case ApplicationCommand(command=command):
            return safe(f"command {command.name}{_fields(command.model_extra or {})}")
        case ApplicationIndication(indication=indication):
            return safe(f"told {indication.name}{_fields(indication.model_extra or {})}")
        case Restart():
            return "RESTART"
    return ""


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
    return (value[0], value[1]) if _is_session(value) else None


def _is_session(value: object) -> bool:
    return isinstance(value, (list, tuple)) and [type(part) for part in value] == [int, int]


def _plain(value: object) -> str:
    """A field value as text; it may have any type, because a log may contain malformed messages."""
    if isinstance(value, (list, tuple)) and _is_session(value):
        return f"{value[0]}/{value[1]}"
    if isinstance(value, (dict, list)):
        return "{..}" if isinstance(value, dict) else "[..]"
    return str(value)


def _content(m: Fields) -> str:
    """The fields that distinguish this message from others of its type."""
    words = []
    if "accepted" in m:
        words.append("accepts" if m["accepted"] is True else "refuses")
    if "reason" in m:
        words.append(f"({_plain(m['reason'])})")
    if "proposal" in m:
        words.append(f"p{_plain(m['proposal'])}")
    of = m.get("of")
    if isinstance(of, dict):
        words.append(f"of {_plain(of.get('type', '?'))}#{_plain(of.get('seq', '?'))}")
    if m["type"] == "CAM":
        marks = m.get("marks")
        words += [_plain(mark) for mark in marks] if isinstance(marks, list) else []
    if "session" in m:
        words.append(f"{_plain(m['session'])}#{_plain(m.get('seq', '?'))}")
    return "".join(f" {word}" for word in words)


def _timer(timer: Timer) -> str:
    match timer:
        case MessageTimer(message=MessageKey() as m):
            return f"{timer.name} {m.type}#{m.seq} ->{m.to or 'all'}"
        case ForgetTimer(station=int(station)):
            return f"{timer.name} {station}"
    return timer.name


_SHOWN_FIELDS = ("reason", "target", "station", "proposal", "session")


def _fields(fields: Fields) -> str:
    words = []
    for name in _SHOWN_FIELDS:
        if name in fields:
            text = _plain(fields[name])
            words.append({"proposal": f"p{text}", "reason": f"({text})"}.get(name, text))
    return "".join(f" {word}" for word in words)
