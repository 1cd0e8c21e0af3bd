"""Logs as a table: a row for each event, a column for each station, in the order of
``event_order``; and its rows as text, with times from the start."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

from rich.cells import cell_len

from automcm_spec.log_format.event_text import (
    Kind,
    Word,
    fitted,
    safe,
    session_of,
    summary,
    words,
)
from automcm_spec.log_format.log import End, Event, Header, Receive, Send, TimerArm, TimerEnd
from automcm_spec.log_format.reader import LogStream, Notice, header_of, records
from automcm_spec.support.bad_input import BadInput, name_of
from automcm_spec.vocabulary.messages import session_in
from automcm_traces.system.copy_folding import Fold, Key, OfCams, folded, key_of
from automcm_traces.system.event_order import Head, Ordered
from automcm_traces.system.fates import Arrow, Fate, Fates, head, is_for
from automcm_traces.system.matching import Ledger, Matches

WIDTH = 80
NARROWEST = 20
"""The minimum column width of a station; with less space, all stations share one column."""
MOST_LINES = 5
"""The maximum number of lines of a row."""


@dataclass(frozen=True, slots=True)
class TableRow:
    """An event or a note about a log, with its place."""

    station: int
    line: int
    event: Event | None
    text: str = ""
    """The note, if there is no event."""
    notes: tuple[str, ...] = ()
    """The fate of a message according to all logs: ``x2002`` lost on the way to 2002, ``?2002`` not
    yet received there, ``!2002`` rejected there, ``2nd`` a second copy of a transmission,
    ``forged`` never sent, ``for 2002`` overheard."""
    arrows: tuple[Arrow, ...] = ()
    """The messages that arrive here, or that leave here and arrive nowhere, without their
    places."""
    phase: str = ""
    """The phase that begins here; empty if it stays the same."""
    problem: bool = False
    """Whether the log cannot be read any further."""

    def as_dict(self) -> dict[str, Any]:
        """The ``--json`` form."""
        return {
            "station": self.station,
            "line": self.line,
            "t_ms": None if self.event is None else self.event.t_ms,
            "kind": self.kind,
            "notes": list(self.notes),
            "arrows": [arrow.as_dict() for arrow in self.arrows],
            "text": safe(self.text) if self.event is None else summary(self.event),
        }

    @property
    def kind(self) -> Kind:
        """The kind of row."""
        return "note" if self.event is None else self.event.ev


class Phases:
    """The phases of stations, whose events come in order; each starts in STANDALONE."""

    def __init__(self) -> None:
        self._now: dict[int, str] = {}

    def change(self, station: int, event: Event) -> str:
        """The phase after the next event of a station; empty if it stays the same."""
        after = event.phase
        if after is None or after == self._now.get(station, "STANDALONE"):
            return ""
        self._now[station] = after
        return after


class Logs:
    """The logs of one run, as one table.

    Raises BadInput if a log has no readable header, or if two logs are of the same station.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths: dict[int, Path] = {}
        runs: dict[str, Path] = {}
        self.warnings: list[str] = []
        for path in paths:
            if path.is_fifo():
                problem = "is a pipe, but must be read twice; save it to a file first"
                raise BadInput(path, 0, "", problem)
            header = header_of(path)
            if header.station in self._paths:
                other = self._paths[header.station]
                problem = f"{header.station} is also the station of {name_of(other)}"
                raise BadInput(path, 1, "station", problem)
            self._paths[header.station] = path
            runs.setdefault(header.run, path)
        if len(runs) > 1:
            names = " and ".join(repr(run) for run in list(runs)[:2])
            self.warnings.append(safe(f"the logs are of different runs: {names}"))
        self.stations = tuple(sorted(self._paths))
        self.good = True
        """Whether every log has been readable so far."""

    def rows(self) -> Iterator[TableRow]:
        """All rows, read lazily: each log twice, to match its messages."""
        paths = [self._paths[station] for station in self.stations]
        matches = Matches([Ledger.of(LogStream(path, past_gaps=True)) for path in paths])
        fates = Fates(matches)
        feeds = [self._feed(i, fates) for i in range(len(paths))]
        for (row,) in Ordered(feeds, matches.clocks.offsets()):
            yield row

    def _feed(self, i: int, fates: Fates) -> Iterator[Head[TableRow]]:
        k = t_ms = 0
        for row in self._rows(self.stations[i]):
            if row.event is None:
                yield Head(row, (i, k), t_ms, note=True)
                continue
            arrows = fates.arrows((i, k), row.event)
            plain = tuple(arrow.plain for arrow in arrows)
            yield head(_noted(row, plain, fates), (i, k), row.event, arrows)
            k, t_ms = k + 1, row.event.t_ms

    def filtered(self, wanted: Filter, last: int = 0) -> Iterable[TableRow]:
        """The rows that pass a filter, in order; with ``last``, only that many from the end."""
        rows = filter(wanted.passes, self.rows())
        return deque(rows, maxlen=last) if last else rows

    def _rows(self, station: int) -> Iterator[TableRow]:
        phases = Phases()
        try:
            for line, record in records(self._paths[station], gaps=True):
                match record:
                    case Notice(problem=problem):
                        yield TableRow(station, line, None, f"-- {problem}")
                    case Header():
                        pass
                    case End(reason=reason, lost_records=lost):
                        more = f", {lost} records lost" if lost else ""
                        yield TableRow(station, line, None, f"-- end: {reason}{more}")
                    case event:
                        phase = phases.change(station, event)
                        yield TableRow(station, line, event, phase=phase)
        except BadInput as error:
            problem = f"{error.field}: {error.problem}" if error.field else error.problem
            self.good = False
            yield TableRow(station, error.line, None, f"-- UNREADABLE: {problem}", problem=True)


def rows_of(station: int, events: Iterable[tuple[int, Event]]) -> Iterator[TableRow]:
    """The rows of events of one station, with their lines."""
    phases = Phases()
    for line, event in events:
        yield TableRow(station, line, event, phase=phases.change(station, event))


def arrow_rows(paths: Sequence[Path]) -> Iterator[tuple[Path, TableRow]]:
    """The rows with arrows, each with its file.

    Logs of one run are judged together; if two of them are of one station, each alone. Raises
    BadInput for a file without a header.
    """
    runs: dict[str, list[tuple[int, Path]]] = defaultdict(list)
    for path in paths:
        header = header_of(path)
        runs[header.run].append((header.station, path))
    for logs in runs.values():
        file_of = dict(logs)
        groups = [file_of] if len(file_of) == len(logs) else [{s: path} for s, path in logs]
        for group in groups:
            for row in Logs(list(group.values())).rows():
                if row.arrows:
                    yield group[row.station], row


_MARKS: dict[Fate, str] = {"lost": "x", "in_flight": "?"}


def _noted(row: TableRow, arrows: tuple[Arrow, ...], fates: Fates) -> TableRow:
    """The row with the fates of its message."""
    if isinstance(row.event, Send):
        notes = [f"{_MARKS[a.fate]}{a.to}" for a in arrows if a.fate in _MARKS]
        notes += [f"!{to}" for to in fates.rejecters]
        return replace(row, notes=tuple(notes), arrows=arrows)
    if not isinstance(row.event, Receive):
        return row
    marks = {"forged": "forged", "duplicated": "2nd"}
    notes = [marks[a.fate] for a in arrows if a.fate in marks]
    m = row.event.message
    if m is not None and not is_for(row.station, m):
        notes.append(f"for {m['dst']}")
    return replace(row, notes=tuple(notes), arrows=arrows)


@dataclass(slots=True)
class Filter:
    """Selects the rows to show. An empty field selects all."""

    stations: frozenset[int] = frozenset()
    session: tuple[int, int] | None = None
    """An event that names no session belongs to the session of the previous event at its
    station."""
    types: frozenset[str] = frozenset()
    """Only sent and received messages of these types."""
    cams: bool = False
    timers: bool = True
    from_line: int = 0
    hidden_cams: int = 0
    """The number of CAMs left out so far."""
    _at: dict[int, tuple[int, int] | None] = field(default_factory=dict)
    _of_cams: OfCams = field(default_factory=OfCams)

    def passes(self, row: TableRow) -> bool:
        """Whether to show a row. Call once for each row, in order."""
        event = row.event
        session = self._at[row.station] = self._session(row)
        if row.line < self.from_line or (self.stations and row.station not in self.stations):
            return False
        if event is None:
            return not (self.types or self.session) or row.problem
        m = event.message if isinstance(event, Send | Receive) else None
        of_cams = not self.cams and self._of_cams.has(row.station, event)
        if self.types and (m is None or m["type"] not in self.types):
            return False
        if not self.timers and isinstance(event, TimerArm | TimerEnd):
            return False
        marks = m.get("marks") if m is not None else None
        marked = isinstance(marks, list) and self.session in map(session_in, marks)
        if self.session not in (None, session) and not marked:
            return False
        self.hidden_cams += of_cams and event.is_cam
        return not of_cams

    def _session(self, row: TableRow) -> tuple[int, int] | None:
        event = row.event
        if event is None:
            return self._at.get(row.station)
        named = session_of(event)
        if named is not None:
            return named
        if event.ev in ("timer", "indication"):
            return self._at.get(row.station)
        if event.ev == "command" and self.session and self.session[0] == row.station:
            return self.session  # a request has no session yet
        return None


def folds(rows: Iterable[TableRow], unfold: bool = False) -> Iterator[Fold[TableRow]]:
    """The rows, each with its copies folded; with ``unfold``, each alone."""

    def key(row: TableRow) -> Key | None:
        if row.event is None or unfold:
            return None
        return key_of(row.station, row.event, (row.notes, row.arrows), bool(row.phase))

    return folded(rows, key)


# -- the rows as text


def first_times(paths: Iterable[Path]) -> dict[int, int]:
    """The time of the first event in each log, by station."""
    found: dict[int, int] = {}
    for path in paths:
        with suppress(BadInput):  # reported where its rows are read
            log = LogStream(path, past_gaps=True)
            for _, event in islice(log, 1):
                found[log.header.station] = event.t_ms
    return found


class LogTable:
    """Lays out rows in columns. Call ``lines`` for one row after the other.

    ``start_ms`` has the time that counts as 0 for each station; the others have absolute times.
    """

    def __init__(
        self,
        stations: Sequence[int],
        width: int = WIDTH,
        start_ms: Mapping[int, int] | None = None,
        longest_ms: int = 0,
    ) -> None:
        self._stations = sorted(set(stations))
        self._start_ms = start_ms or {}
        self._time = max(8, len(str(longest_ms)))
        self._gutter = self._time + 8
        room = max(width, 40) - self._gutter
        each = room // max(len(self._stations), 1)
        self._apart = each > NARROWEST or len(self._stations) == 1
        self._width = each - 1 if self._apart else room - 11

    def head(self) -> list[str]:
        """The column headings."""
        time = f"{'t_ms' if not self._start_ms else 'ms':>{self._time}} {'line':>6}"
        if not self._apart:
            return [f"{time} {'station':>10}"]
        names = " ".join(fitted(str(s), self._width) for s in self._stations)
        return [f"{time} {names}".rstrip()]

    def lines(self, row: TableRow, mark: str = "") -> Iterator[tuple[Kind, str]]:
        """The row, and a further line if it changes the phase of its station.

        ``mark`` is that of its fold.
        """
        t_ms = ""
        if row.event is not None:
            t_ms = str(row.event.t_ms - self._start_ms.get(row.station, 0))
        gutter = f"{t_ms:>{self._time}} {row.line:>6} "
        for line in self._texts(row, mark):
            yield row.kind, self._cell(gutter, row.station, line)
            gutter = " " * self._gutter
        if row.phase:
            yield "phase", self._cell(" " * self._gutter, row.station, f"= {safe(row.phase)}")

    def _texts(self, row: TableRow, mark: str) -> list[str]:
        """The row as lines that fit."""
        if row.event is None:
            return [fitted(safe(row.text), self._width)]
        m = row.event.message if isinstance(row.event, Send) else {}
        to_one = isinstance(m.get("dst"), int) and len(row.notes) == 1
        marks = [Word(note, (note[0],) if to_one else (), 3) for note in row.notes]
        return wrapped([*marks, *words(row.event), Word(mark)], self._width)

    def _cell(self, gutter: str, station: int, label: str) -> str:
        if not self._apart:
            return f"{gutter}{station:>10} {label}".rstrip()
        before = self._stations.index(station) * (self._width + 1)
        return (gutter + " " * before + label).rstrip()


def wrapped(parts: Sequence[Word], width: int) -> list[str]:
    """The words in one line of ``width`` columns, shortened as far as needed; in several lines if
    that is not enough."""
    texts = [safe(part.text) for part in parts]
    ranked = sorted(range(len(parts)), key=lambda n: parts[n].rank)
    for n, shorter in [(k, text) for k in ranked for text in parts[k].shorter]:
        if _size(" ".join(filter(None, texts))) <= width:
            break
        texts[n] = safe(shorter)
    lines = [""]
    for text in filter(None, texts):
        longer = f"{lines[-1]} {text}" if lines[-1] else text
        if lines[-1].strip() and _size(longer) > width:
            longer = f"  {text}"
            lines.append("")
        lines[-1] = longer
    if len(lines) > MOST_LINES:
        lines[MOST_LINES - 1 :] = [" ".join([lines[MOST_LINES - 1], *lines[MOST_LINES:]])]
    return [fitted(line, width).rstrip() for line in lines]


def _size(text: str) -> int:
    return len(text) if text.isascii() else cell_len(text)


def columns(
    rows: Iterable[TableRow],
    stations: Sequence[int],
    width: int = WIDTH,
    start_ms: Mapping[int, int] | None = None,
) -> list[str]:
    """The rows as lines of at most ``width`` terminal columns, with column headings."""
    table = LogTable(stations, width, start_ms)
    return table.head() + [line for row in rows for _, line in table.lines(row)]
