"""A verdict for a person, and what he can do with it: the failing prefix, and how to replay it."""

from __future__ import annotations

import json
import shlex
from collections.abc import Collection, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from automcm_spec import files
from automcm_spec.bad_input import at_line, printable
from automcm_traces.explain import Verdict
from automcm_traces.show import Row, columns

Json = Any
SESSIONS = 10
"""Sessions of a log that are shown, the last ones."""


def text(verdict: Verdict) -> str:
    """The verdict in lines of a terminal, with what the reader had to overlook."""
    lines = [*_lines(verdict), *(f"  warning: {warning}" for warning in verdict.warnings)]
    return "\n".join(map(printable, lines))


def _lines(verdict: Verdict) -> Iterator[str]:
    found = verdict.finding
    where = at_line(verdict.file, found.at.line)
    match verdict.verdict:
        case "allowed":
            yield f"{verdict.file}: ALLOWED, {verdict.events} events"
            yield from _allowed(verdict)
        case "unreadable":
            yield f"{where}: UNREADABLE: {found.observed}"
        case "cannot_tell":
            yield f"{where}: CANNOT TELL: {found.observed}"
        case "diverges":
            yield f"{where}: DIVERGES at {found.observed}"
            yield from _diverges(verdict)


def _allowed(verdict: Verdict) -> Iterator[str]:
    if verdict.unobserved:
        kinds, n = ", ".join(verdict.unobserved), verdict.possible_states
        states = f"{n} state{'' if n == 1 else 's'} of the specification"
        yield f"  not logged: {kinds}; at its end the log fits {states}"
    suppositions = verdict.only_if[-SESSIONS:]
    if len(verdict.only_if) > len(suppositions):
        yield f"  allowed only if {len(verdict.only_if)} things happened unseen; the last of them:"
    yield from (f"  allowed only if {supposition}" for supposition in suppositions)
    shown = verdict.sessions[-SESSIONS:]
    if verdict.number_of_sessions > len(shown):
        yield f"  {verdict.number_of_sessions} sessions; the last of them:"
    yield from (f"  {session}" for session in shown)


def expected(these: Sequence[str]) -> list[str]:
    """What was to come instead, in a line; no line for nothing."""
    order = ", in any order" if len(these) > 1 else ""
    return [f"expected{order}: {'; '.join(these)}"] if these else []


def _diverges(verdict: Verdict) -> Iterator[str]:
    yield from (f"  {line}" for line in expected(verdict.finding.expected))
    why = verdict.finding.why
    if why.guard:
        by = "by" if why.of_last_input else "last input decided by"
        yield f"  {by} {why.guard}"
    yield from (f"  {line}" for line in why.lines())
    n = verdict.possible_states
    if n != 1 or verdict.unobserved:
        yield f"  {n} state{'' if n == 1 else 's'} of the specification fitted before"
    if verdict.sessions:
        yield f"  in {verdict.sessions[-1]}"
    if verdict.recent and verdict.header is not None:
        station = verdict.header.station
        rows = [Row(station, line, event) for line, event in verdict.recent]
        yield from (f"  {line}" for line in columns(rows, [station], 78))


def prefix(
    verdict: Verdict, folder: Path, taken: Collection[Path] = (), log: Path | None = None
) -> Path:
    """Write what the log says up to the divergence as a log of its own; the verdict on it is the
    same.  Its name is none of those ``taken``.  ``log`` is the file, if the verdict names another.

    Raises OSError.
    """
    lines = max(verdict.seen, verdict.finding.at.line)
    folder.mkdir(parents=True, exist_ok=True)
    log = Path(verdict.file) if log is None else log
    name = f"{log.stem}-{verdict.finding.at.line}"
    path, n = folder / f"{name}.ndjson", 1
    while path in taken:
        n += 1
        path = folder / f"{name}-{n}.ndjson"
    with open(log, "rb") as stream:
        kept = list(islice(stream, lines))
    last: dict[str, Json] = json.loads(kept[-1])
    kept[-1] = kept[-1].removesuffix(b"\n") + b"\n"
    end = {"rec": "end", "seq": last["seq"], "reason": "prefix", "lost_records": 0}
    kept.append(json.dumps(end).encode() + b"\n")
    files.write(path, b"".join(kept))
    return path


def replay(path: Path) -> str:
    """The command that gives the inputs of a log to an implementation."""
    return f"automcm trace replay {shlex.quote(str(path))} -- YOUR_ADAPTER"
