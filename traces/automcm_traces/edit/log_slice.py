"""Makes a log from part of another: fewer steps, with the gaps closed.

A step is an input with its effects; a sent CAM is a step by itself. Leaving out steps may leave
gaps in times and numbers. ``closed_up`` closes them: timers keep their durations, expiries keep
their delays, and a seq or proposal that nothing names any more is skipped.
"""

from __future__ import annotations

import json
from collections import defaultdict, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from automcm_spec.log_format.event_text import session_of
from automcm_spec.log_format.log import End, Event, Header, Send, record
from automcm_spec.log_format.reader import Log, LogStream, NotJsonError, parse, records
from automcm_spec.support.bad_input import name_of

Json = Any
Numbers = dict[tuple[str, ...], set[int]]


@dataclass(frozen=True, slots=True)
class Item:
    """An event, its line in the original log, and its record to write, with vendor fields."""

    line: int
    event: Event
    record: dict[str, Json]


@dataclass(frozen=True, slots=True)
class LogSlice:
    """The remaining part of a log."""

    file: str
    header: Header
    head: dict[str, Json]
    end: dict[str, Json] | None
    items: tuple[Item, ...]

    @staticmethod
    def read(path: str | Path, lines: int = 0) -> LogSlice:
        """The log in a file, complete or its first ``lines``; events of unknown kinds are left out.

        It has an end record if the file has one, even after ``lines``. Raises OSError and BadInput.
        """
        log = LogStream(path, past_gaps=True) if lines else LogStream(path, entries=records(path))
        with open(path, "rb") as stream:
            texts = list(islice(stream, lines or None))
            last = (deque(stream, 1) or texts)[-1]
        items = []
        for line, event in log:
            items.append(Item(line, event, json.loads(texts[line - 1])))
            if line == lines:
                break
        header, head = log.header, json.loads(texts[0])
        if items and json.loads(texts[1])["seq"] > 1:  # it is numbered anew: the header says it
            head["begins"] = "running"
            header = header.model_copy(update={"begins": "running"})
        return LogSlice(name_of(path), header, head, _end(last), tuple(items))

    def having(self, items: Sequence[Item]) -> LogSlice:
        """The same log with only these items."""
        return LogSlice(self.file, self.header, self.head, self.end, tuple(items))

    def log(self) -> Log:
        """The log for the engine, with the lines of the original log."""
        events = [(item.line, item.event) for item in self.items]
        end = None if self.end is None else End.model_validate(self.end)
        return Log(self.file, self.header, events, end, False, [])

    def text(self) -> bytes:
        """The log as a file, with its events renumbered."""
        records = [self.head]
        records += [item.record | {"seq": n} for n, item in enumerate(self.items, 1)]
        if self.end is not None:
            records.append(self.end | {"seq": len(self.items)})
        return b"".join(
            json.dumps(r, ensure_ascii=False, separators=(",", ":")).encode() + b"\n"
            for r in records
        )

    def steps(self) -> list[list[Item]]:
        """The events, grouped by step."""
        found: list[list[Item]] = []
        last: list[Item] | None = None
        for item in self.items:
            alone = isinstance(item.event, Send) and item.event.is_cam
            if alone or last is None or item.event.is_input:
                found.append([item])
                last = last if alone else found[-1]
            else:
                last.append(item)
        return found

    def effects(self) -> list[list[Item]]:
        """Each event that is not an input."""
        return [[item] for item in self.items if not item.event.is_input]

    def by_session(self) -> dict[tuple[int, int], list[Item]]:
        """The steps of each session; a step that names none belongs to the session of the previous
        step."""
        found: dict[tuple[int, int], list[Item]] = {}
        at: tuple[int, int] | None = None
        for step in self.steps():
            named = [s for item in step if (s := session_of(item.event)) is not None]
            at = named[0] if named else at
            if at is not None:
                found.setdefault(at, []).extend(step)
        return found

    def by_number(self) -> list[list[Item]]:
        """The steps about each proposal, then about each message, including messages about that
        message."""
        station = self.header.station
        steps = [(step, _numbers((i.record for i in step), station)) for step in self.steps()]
        topics = {(key, n) for _, named in steps for key, ns in named.items() for n in ns if n}
        found = []
        for key, n in sorted(topics):
            about = [named for _, named in steps if n in named.get(key, ())]
            more = _numbers((i.record for i in self.items if _is_about(i, key, n)), station)
            more = more if key[0] == "proposal" else {key: {n}}
            away = [s for s, named in steps if named in about or _overlap(named, more)]
            found.append([item for step in away for item in step])
        return found

    def closed_up(self, left: Sequence[Item]) -> LogSlice:
        """The log with only the items ``left``, in order, with the gaps closed."""
        moved = _retimed(self.items, {id(item) for item in left})
        station = self.header.station
        gone = _numbers((item.record for item in self.items), station)
        for key, values in _numbers((item.record for item in left), station).items():
            gone[key] -= values
        gone = {key: values for key, values in gone.items() if values}
        return self.having([_renumbered(item, gone, station) for item in moved] if gone else moved)


def _end(last: bytes) -> dict[str, Json] | None:
    """The end record of a log, if its last line is one."""
    try:
        return json.loads(last) if isinstance(parse(last), End) else None
    except (NotJsonError, ValidationError):
        return None


def _retimed(items: Sequence[Item], left: set[int]) -> list[Item]:
    """The remaining items with new times: each keeps its distance to the previous event, an expiry
    its distance to the deadline."""
    found: list[Item] = []
    deadlines: dict[str, tuple[int, int]] = {}
    """By timer, the old and the new deadline."""
    was = now = 0
    for item in items:
        old = item.event.t_ms
        gap, was = old - was, old
        if id(item) not in left:
            if not found:
                now = old  # the first remaining event keeps its time
            continue
        fields = item.record
        timer = json.dumps(fields.get("timer"), sort_keys=True)
        if fields.get("op") == "expire" and timer in deadlines:
            before, after = deadlines.pop(timer)
            new = max(now, after + old - before)
        else:
            new = now + gap if found else old
        if fields.get("op") == "arm":
            deadlines[timer] = fields["deadline"], fields["deadline"] + new - old
        elif fields.get("op") == "stop":
            deadlines.pop(timer, None)
        found.append(_at(item, new - old))
        now = new
    return found


def _at(item: Item, shift: int) -> Item:
    if not shift:
        return item
    times = [name for name in ("t_ms", "deadline") if name in item.record]
    moved = {name: max(0, item.record[name] + shift) for name in times}
    return Item(item.line, replace(item.event, **moved), item.record | moved)


def _numbers(records: Iterator[dict[str, Json]], station: int) -> Numbers:
    """The seqs and proposals that records name, by their owner."""
    found: Numbers = defaultdict(set)
    for fields in records:
        for key, holder, name in _named(fields, station):
            found[key].add(holder[name])
    return found


def _named(
    fields: dict[str, Json], station: int
) -> Iterator[tuple[tuple[str, ...], dict[str, Json], str]]:
    """The places where a record names a seq or a proposal: its owner, and the place."""
    holders = [fields[part] for part in ("message", "command", "indication") if part in fields]
    if "indication" in fields:
        holders += [value for value in fields["indication"].values() if isinstance(value, dict)]
    for holder in holders:
        if type(holder.get("proposal")) is int:
            yield ("proposal", str(holder.get("session"))), holder, "proposal"
        if type(holder.get("seq")) is int:
            yield ("seq", str(holder.get("session")), str(holder.get("src"))), holder, "seq"
        of = holder.get("of")
        if isinstance(of, dict) and type(of.get("seq")) is int:
            yield ("seq", str(holder.get("session")), str(holder.get("dst"))), of, "seq"
    about = fields["timer"].get("message") if "timer" in fields else None
    if about:
        yield ("seq", str(about["session"]), str(station)), about, "seq"


def _is_about(item: Item, key: tuple[str, ...], n: int) -> bool:
    """Whether the item is a message about this proposal."""
    m = item.record.get("message", {})
    return m.get("proposal") == n and str(m.get("session")) == key[1]


def _overlap(one: Numbers, other: Numbers) -> bool:
    return any(key[0] == "seq" and (ns - {0}) & other.get(key, set()) for key, ns in one.items())


def _renumbered(item: Item, gone: Numbers, station: int) -> Item:
    changes = [
        lower
        for key, holder, name in _named(item.record, station)
        if (lower := sum(0 < value < holder[name] for value in gone.get(key, ())))
    ]
    if not changes:
        return item
    fields = json.loads(json.dumps(item.record))
    for key, holder, name in list(_named(fields, station)):
        holder[name] -= sum(0 < value < holder[name] for value in gone.get(key, ()))
    event = record(json.dumps(fields).encode())
    assert not isinstance(event, Header | End)
    return Item(item.line, event, fields)
