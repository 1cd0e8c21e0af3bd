"""A log without the details that an implementation may choose.

Two logs with the same behaviour may still differ in session numbers, in transmission ids, in the
order of the effects of one step, in which of several messages of one step has the lower seq, in
times, and in CAMs. ``steps`` yields the steps of a log without these differences.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from automcm_spec.log_format.log import RECORD, Event, Receive, Send
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary.messages import session_in
from automcm_traces.system.fates import is_for

Json = Any
IDS = ("dst", "src", "station", "target", "to")
"""Fields that name a station."""
RANDOM = ("backoff",)
"""Timers whose duration is random."""


@dataclass(frozen=True, slots=True)
class CanonicalEvent:
    """One event: its place in the log, and its comparable fields."""

    line: int
    event: Event
    fields: dict[str, Json]

    @property
    def key(self) -> str:
        """A text that is equal for equal events."""
        return json.dumps(self.fields, sort_keys=True)

    @property
    def kind(self) -> tuple[Json, ...]:
        """The kind of event: two events of one kind differ only in other fields."""
        f = self.fields
        inner: Json = next(
            (f[k] for k in ("message", "timer", "command", "indication") if k in f), {}
        )
        about = f.get("timer", {}).get("message", {})
        to = inner.get("dst", inner.get("src")), about.get("type"), about.get("to")
        return f["ev"], f.get("op"), inner.get("type", inner.get("name")), *to


@dataclass(slots=True)
class CanonicalStep:
    """An input and its effects; the input is None if the log has none before the effects."""

    input: CanonicalEvent | None
    effects: list[CanonicalEvent] = field(default_factory=list)

    @property
    def events(self) -> list[CanonicalEvent]:
        """The input, if there is one, and the effects."""
        return [*([self.input] if self.input is not None else []), *self.effects]


class Canonical:
    """One log in canonical form.

    ``ids`` maps stations to the ids to use for them. Only events of these ``kinds`` are included.
    """

    def __init__(
        self, log: Log, kinds: Sequence[str], ids: Mapping[int, int] | None = None
    ) -> None:
        self._log, self._kinds, self._ids = log, frozenset(kinds), dict(ids or {})
        self._numbers: dict[Json, list[int]] = {}
        """For each prescriber, its session numbers in order of appearance."""
        self._seqs: dict[tuple[str, int], int] = {}
        """The canonical seq of the station's own messages, by session and seq."""

    def steps(self) -> Iterator[CanonicalStep]:
        """The steps, without CAMs, the timer that each CAM re-arms, and messages for others."""
        step: list[tuple[int, Event]] = []
        mine = self._log.header.station
        for line, event in self._log.events:
            if event.ev not in self._kinds or (isinstance(event, Send) and event.is_cam):
                continue
            if isinstance(event, Receive) and not is_for(mine, event.message or {}):
                continue  # it is ignored (MSG-1)
            if event.is_input and step:
                yield from self._canonical_step(step)
                step = []
            step.append((line, event))
        if step:
            yield from self._canonical_step(step)

    def _canonical_step(self, step: list[tuple[int, Event]]) -> Iterator[CanonicalStep]:
        first = step[0][1]
        if isinstance(first, Receive) and first.is_cam:
            step = [(line, e) for line, e in step[1:] if not e.is_cam_timer]
            if not step:
                return
        self._order(step)
        events = [self._canonical_event(line, event) for line, event in step]
        if step[0][1].is_input:
            yield CanonicalStep(events[0], events[1:])
        else:
            yield CanonicalStep(None, events)

    def _order(self, step: list[tuple[int, Event]]) -> None:
        """Order the new messages of one step: the message to the lower station gets the lower
        seq."""
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

    def _canonical_event(self, line: int, event: Event) -> CanonicalEvent:
        fields = RECORD.dump_python(event, by_alias=True, exclude_none=True)
        for name in ("rec", "seq", "t_ms", "tx", "rule", "phase", "role"):
            fields.pop(name, None)
        deadline = fields.pop("deadline", None)
        timer = fields.get("timer", {})
        if deadline is not None and timer.get("name") not in RANDOM:
            fields["duration_ms"] = deadline - event.t_ms
        mine = self._log.header.station
        for name in ("message", "command", "indication", "timer"):
            if name in fields:
                fields[name] = self._plain(fields[name], mine)
        fields.get("indication", {}).pop("rule", None)
        return CanonicalEvent(line, event, fields)

    def _plain(self, value: Json, mine: int) -> Json:
        """The comparable form of a message or another value that names stations, sessions or
        seqs."""
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
        """The canonical seq of one of the station's own messages."""
        seq = value.get("seq")
        if own and type(seq) is int:
            seq = self._seqs.get(about, seq)
        return {} if seq is None else {"seq": seq}

    def _id(self, value: Json) -> Json:
        return self._ids.get(value, value) if type(value) is int else value

    def _session(self, value: Json) -> Json:
        """The canonical session: numbered per prescriber in order of appearance."""
        if (session := session_in(value)) is None:
            return value
        prescriber = self._id(session[0])
        known = self._numbers.setdefault(prescriber, [])
        if session[1] not in known:
            known.append(session[1])
        return [prescriber, known.index(session[1]) + 1]


def _named(value: dict[str, Json]) -> str:
    """The session of a message or timer as text, even if it is malformed."""
    return json.dumps(value.get("session"))
