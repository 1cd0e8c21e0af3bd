"""What a log says, without what an implementation is free to choose.

Two logs that say the same may still differ in the numbers of sessions, in transmission ids, in the
order of the effects of one step, in which of several messages of one step has the lower seq, in
times, and in CAMs.  ``steps`` gives the steps of a log with all that taken out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from automcm_traces.edit.log_slice import is_input
from automcm_traces.format.log import Event, Receive, Send, TimerArm, TimerEnd
from automcm_traces.format.reader import Log

Json = Any
IDS = ("dst", "src", "station", "target", "to")
"""Fields that name a station."""
RANDOM = ("backoff",)
"""Timers whose duration is random."""


@dataclass(frozen=True, slots=True)
class Deed:
    """One event: its place in the log, and what can be compared of it."""

    line: int
    event: Event
    fields: dict[str, Json]
    phase: tuple[str | None, str | None]
    """Phase and role after it, where the log says so."""

    @property
    def key(self) -> str:
        """A text that is equal for equal deeds."""
        return json.dumps(self.fields, sort_keys=True)

    @property
    def kind(self) -> tuple[Json, ...]:
        """Two that are of one kind differ in fields, others altogether."""
        f = self.fields
        inner: Json = next(
            (f[k] for k in ("message", "timer", "command", "indication") if k in f), {}
        )
        about = f.get("timer", {}).get("message", {})
        to = inner.get("dst", inner.get("src")), about.get("type"), about.get("to")
        return f["ev"], f.get("op"), inner.get("type", inner.get("name")), *to


@dataclass(slots=True)
class DeedStep:
    """An input, or None if the log has none before the effects, and the effects."""

    input: Deed | None
    effects: list[Deed] = field(default_factory=list)

    @property
    def deeds(self) -> list[Deed]:
        """The input, if there is one, and what came of it."""
        return [*([self.input] if self.input is not None else []), *self.effects]


class Canonical:
    """One log, said anew.  ``ids`` are stations to be called otherwise; of the kinds of event only
    ``kinds`` are looked at."""

    def __init__(
        self, log: Log, kinds: Sequence[str], ids: Mapping[int, int] | None = None
    ) -> None:
        self._log, self._kinds, self._ids = log, frozenset(kinds), dict(ids or {})
        self._numbers: dict[Json, list[int]] = {}
        """By prescriber the numbers of its sessions, as they come."""
        self._seqs: dict[tuple[str, int], int] = {}
        """Of its own messages, by session."""

    def steps(self) -> Iterator[DeedStep]:
        """The steps, without CAMs and the timer that each arms anew."""
        step: list[tuple[int, Event]] = []
        for line, event in self._log.events:
            if event.ev not in self._kinds or _sends_cam(event):
                continue
            if is_input(event) and step:
                yield from self._said(step)
                step = []
            step.append((line, event))
        if step:
            yield from self._said(step)

    def _said(self, step: list[tuple[int, Event]]) -> Iterator[DeedStep]:
        first = step[0][1]
        if _receives_cam(first):
            step = [(line, e) for line, e in step[1:] if not _cam_timer(e)]
            if not step:
                return
        self._order(step)
        deeds = [self._deed(line, event) for line, event in step]
        if is_input(step[0][1]):
            yield DeedStep(deeds[0], deeds[1:])
        else:
            yield DeedStep(None, deeds)

    def _order(self, step: list[tuple[int, Event]]) -> None:
        """Of new messages of one step, the one to the lower station has the lower seq."""
        fresh: dict[str, list[tuple[tuple[str, int], int]]] = {}
        for _, event in step:
            if not isinstance(event, Send):
                continue
            m = event.message
            session, seq = _named(m), m.get("seq")
            if type(seq) is int and seq and (session, seq) not in self._seqs:
                to = self._id(m.get("dst", 0))
                whom = str(m["type"]), int(to) if type(to) is int else 0
                fresh.setdefault(session, []).append((whom, seq))
        for session, sent in fresh.items():
            seqs = sorted(seq for _, seq in sent)
            for (_, seq), place in zip(sorted(sent), seqs, strict=True):
                self._seqs[session, seq] = place

    def _deed(self, line: int, event: Event) -> Deed:
        fields = event.model_dump(by_alias=True, exclude_none=True)
        phase = fields.pop("phase", None), fields.pop("role", None)
        for name in ("rec", "seq", "t_ms", "tx", "rule"):
            fields.pop(name, None)
        deadline = fields.pop("deadline", None)
        timer = fields.get("timer", {})
        if deadline is not None and timer.get("name") not in RANDOM:
            fields["duration_ms"] = deadline - event.t_ms
        mine = self._log.header.station
        for name in ("message", "command", "indication", "timer"):
            if name in fields:
                fields[name] = self._plain(fields[name], mine)
        told = fields.get("indication")
        if told is not None:
            told.pop("rule", None)
        return Deed(line, event, fields, phase)

    def _plain(self, value: Json, mine: int) -> Json:
        """A message, or whatever names stations, sessions or seqs, as it is compared."""
        if not isinstance(value, dict):
            return [self._plain(v, mine) for v in value] if isinstance(value, list) else value
        out = {}
        for name, inner in value.items():
            if name in IDS:
                out[name] = self._id(inner)
            elif name == "session":
                out[name] = self._session(inner)
            elif name == "stations" and isinstance(inner, list):
                out[name] = sorted((self._id(one) for one in inner), key=str)
            elif name == "of" and isinstance(inner, dict):
                about = _named(value), inner.get("seq")
                out[name] = inner | self._seq(about, value.get("dst") == mine, inner)
            else:
                out[name] = self._plain(inner, mine)
        if "seq" in value:
            own = value.get("src", mine) == mine
            out |= self._seq((_named(value), value["seq"]), own, value)
        return out

    def _seq(self, about: tuple[str, Json], own: bool, value: dict[str, Json]) -> dict[str, Json]:
        """The seq of one of its own messages, in the order of the addressees."""
        seq = value.get("seq")
        if own and type(seq) is int:
            seq = self._seqs.get(about, seq)
        return {} if seq is None else {"seq": seq}

    def _id(self, value: Json) -> Json:
        return self._ids.get(value, value) if type(value) is int else value

    def _session(self, value: Json) -> Json:
        """The nth session of its prescriber that the log names."""
        if not isinstance(value, list | tuple) or [type(part) for part in value] != [int, int]:
            return value
        prescriber = self._id(value[0])
        known = self._numbers.setdefault(prescriber, [])
        if value[1] not in known:
            known.append(value[1])
        return [prescriber, known.index(value[1]) + 1]


def _named(value: dict[str, Json]) -> str:
    """The session of a message or timer, whatever it is."""
    return json.dumps(value.get("session"))


def _sends_cam(event: Event) -> bool:
    return isinstance(event, Send) and event.message["type"] == "CAM"


def _receives_cam(event: Event) -> bool:
    m = event.message if isinstance(event, Receive) else None
    return m is not None and m["type"] == "CAM"


def _cam_timer(event: Event) -> bool:
    return isinstance(event, TimerArm | TimerEnd) and event.timer.name == "cam"
