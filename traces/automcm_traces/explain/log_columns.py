"""Rows of a log table as text: a column for each station, times from the start."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path

from rich.cells import cell_len

from automcm_spec.log_format.event_text import Kind, Word, fitted, safe, words
from automcm_spec.log_format.log import Send
from automcm_spec.log_format.reader import LogStream
from automcm_spec.support.bad_input import BadInput
from automcm_traces.explain.log_table import TableRow
from automcm_traces.system.copy_folding import Key, folded, key_of

WIDTH = 80
NARROWEST = 20
"""The minimum column width of a station; with less space, all stations share one column."""
MOST_LINES = 5
"""The maximum number of lines of a row."""
TIMES = "\N{MULTIPLICATION SIGN}"


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

    def lines(self, row: TableRow, times: int = 1) -> Iterator[tuple[Kind, str]]:
        """The row, and a further line if it changes the phase of its station.

        ``times`` is the number of copies for which the row stands.
        """
        t_ms = ""
        if row.event is not None:
            t_ms = str(row.event.t_ms - self._start_ms.get(row.station, 0))
        gutter = f"{t_ms:>{self._time}} {row.line:>6} "
        for line in self._texts(row, times):
            yield row.kind, self._cell(gutter, row.station, line)
            gutter = " " * self._gutter
        if row.phase:
            yield "phase", self._cell(" " * self._gutter, row.station, f"= {safe(row.phase)}")

    def _texts(self, row: TableRow, times: int) -> list[str]:
        """The row as lines that fit."""
        if row.event is None:
            return [fitted(safe(row.text), self._width)]
        m = row.event.message if isinstance(row.event, Send) else {}
        to_one = isinstance(m.get("dst"), int) and len(row.notes) == 1
        marks = [Word(note, (note[0],) if to_one else (), 3) for note in row.notes]
        copies = [Word(f"{TIMES}{times}")] if times > 1 else []
        return wrapped([*marks, *words(row.event), *copies], self._width)

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


def folds(rows: Iterable[TableRow], unfold: bool = False) -> Iterator[tuple[TableRow, int]]:
    """The rows, and the number of copies for which each stands: 1 with ``unfold``."""

    def key(row: TableRow) -> Key | None:
        if row.event is None or unfold:
            return None
        return key_of(row.station, row.event, (row.notes, row.arrows), bool(row.phase))

    return ((fold.first, fold.times) for fold in folded(rows, key))
