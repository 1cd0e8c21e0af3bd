"""What a page shows, as compact JSON: rows in one order, arrows, timer bars, states, verdicts.

``viewer/data.js`` reads it and says in the same words what each part is.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from automcm_spec.paths import TLA
from automcm_spec.rules import RULES, operators
from automcm_traces.clocks import Clocks
from automcm_traces.delivery import Deliveries
from automcm_traces.explain import Verdict, explain_files, together
from automcm_traces.log import Event, Receive, Send, TimerArm, TimerEnd
from automcm_traces.merge import Merged, MergeError, Node, merge
from automcm_traces.page_follow import Followed, follow
from automcm_traces.page_pack import Shapes, Table
from automcm_traces.properties import SystemReport
from automcm_traces.reader import Log, LogError, LogStream
from automcm_traces.words import said, session_of

Json = Any
MOST_LOGS = 200
"""Beyond, what one log says of another takes too long to work out."""
MOST_EVENTS = 1_000_000
"""Beyond, a browser cannot hold the page."""
GHOSTS = 12
"""Stations without a log that have a column each; if there are more, all share one."""
DELIVERED, LOST, DUPLICATE, UNOBSERVED, IN_FLIGHT, UNSENT, FORGED = range(7)
KINDS = {"duplicated": DUPLICATE, "lost": LOST, "unobserved": UNOBSERVED, "in_flight": IN_FLIGHT}
OF_CAM = 1
"""A CAM, or the timer that it arms anew."""
IS_CAM = 2


class PageError(Exception):
    """What cannot be shown as a page; the text is one line."""


@dataclass(slots=True)
class Page:
    """What one page shows.  ``nodes`` are its rows: the place of a log, and of an event in it."""

    title: str
    merged: Merged
    verdicts: list[Verdict]
    system: SystemReport | None
    nodes: list[Node] = field(default_factory=list)
    followed: list[Followed] = field(default_factory=list)
    ghosts: list[int] = field(default_factory=list)
    """Stations without a log that have a column of their own, after the logs."""
    crowded: bool = False
    """There are too many of them: one column for all."""
    renamed: tuple[str, str] = ("", "")
    """What stands before the names of the files, and what is shown instead."""

    @property
    def logs(self) -> Sequence[Log]:
        return self.merged.logs

    def event(self, row: int) -> Event:
        return self.merged.event(self.nodes[row])


def load(paths: Sequence[Path], title: str = "", late_ms: int | None = None) -> Page:
    """Read and judge the logs of one run.  A log that cannot be read to its end is shown up to
    there; of one without a header there is only the verdict.

    Raises PageError, LogError if no log has a header, and automcm_spec.oracle.OracleError if
    there is no oracle.
    """
    if len(paths) > MOST_LOGS:
        raise PageError(f"{len(paths)} logs; a page shows at most {MOST_LOGS}")
    logs, refused = [], []
    for path in paths:
        try:
            logs.append(_whole(path))
        except LogError as error:
            refused.append(error)  # its verdict says so
    if refused and not logs:
        raise refused[0]
    if sum(len(log.events) for log in logs) > MOST_EVENTS:
        raise PageError(f"more than {MOST_EVENTS} events; a page shows no more")
    try:
        merged = merge(logs)
    except MergeError as error:
        raise PageError(str(error)) from None
    verdicts = explain_files(paths, late_ms)
    system = together(paths) if len(paths) > 1 else None
    page = Page(title or _title(merged), merged, verdicts, system)
    page.nodes = _order(merged)
    page.followed = [follow(log) for log in merged.logs]
    named = sorted(_named(merged) - set(merged.stations))
    page.crowded = len(named) > GHOSTS
    page.ghosts = [] if page.crowded else named
    return page


def _title(merged: Merged) -> str:
    stations = ", ".join(map(str, merged.stations[:4])) + (", …" if merged.stations[4:] else "")
    return f"{merged.run}: {stations}"


def _whole(path: Path) -> Log:
    """The log in a file, up to where it can be read."""
    stream = LogStream(path)
    events: list[tuple[int, Event]] = []
    try:
        for entry in stream:
            events.append(entry)
            if len(events) > MOST_EVENTS:
                raise PageError(f"{path}: more than {MOST_EVENTS} events; a page shows no more")
    except LogError:
        pass  # its verdict says where and why
    return Log(
        stream.file, stream.header, events, stream.end, stream.truncated, list(stream.warnings)
    )


def _order(merged: Merged) -> list[Node]:
    """Every event: each after what it depends on, else the lower t_ms first, then the station."""
    needs = {node: match.first for node, match in merged.matches.items()}
    at = [0] * len(merged.logs)
    waiting: list[set[int]] = [set() for _ in merged.logs]
    heap: list[tuple[int, int]] = []
    order: list[Node] = []

    def offer(i: int) -> None:
        """The next event of a log, if it can come now."""
        if at[i] == len(merged.logs[i].events):
            return
        sent = needs.get((i, at[i]))
        if sent is not None and at[sent[0]] <= sent[1]:
            waiting[sent[0]].add(i)
        else:
            heapq.heappush(heap, (merged.logs[i].events[at[i]][1].t_ms, i))

    for i in range(len(at)):
        offer(i)
    while heap or any(waiting):
        if not heap:  # received before it was sent: the report says so
            i = min(set().union(*waiting))
            for others in waiting:
                others.discard(i)
            del needs[i, at[i]]
            offer(i)
            continue
        _, i = heapq.heappop(heap)
        order.append((i, at[i]))
        at[i] += 1
        woken, waiting[i] = waiting[i], set()
        for j in (i, *sorted(woken)):
            offer(j)
    return order


def _named(merged: Merged) -> set[int]:
    """Every station that sent or is sent a message."""
    found: set[int] = set()
    for log in merged.logs:
        for _, event in log.events:
            m = event.message if isinstance(event, Send | Receive) else None
            for name in ("src", "dst") if m is not None else ():
                value = m.get(name) if m is not None else None
                if type(value) is int and value > 0:
                    found.add(value)
    return found


def as_dict(page: Page) -> dict[str, Json]:
    """Everything, as ``viewer/data.js`` reads it."""
    strings, shapes = Table(), Shapes()
    rows = _rows(page, strings, shapes)
    row_of = {node: row for row, node in enumerate(page.nodes)}
    steps = [_steps(f, strings) for f in page.followed]
    told = judged(page)
    return {
        "title": page.title,
        "logs": _renamed(page, [_log(page, i, row_of) for i in range(len(page.logs))]),
        "ghosts": page.ghosts,
        "crowded": page.crowded,
        "verdicts": told["logs"],
        "system": told["system"],
        "hazards": _renamed(page, [h.text() for h in page.system.hazards] if page.system else []),
        "rows": rows,
        "arrows": _arrows(page, row_of),
        "bars": _bars(page, row_of),
        "steps": steps,
        "operators": _used(page.followed),
        "rules": {r: RULES.get(r, "") for r in sorted({r for f in page.followed for r in f.rules})},
        "strings": strings.values,
        "shapes": shapes.keys,
    }


def judged(page: Page) -> dict[str, Json]:
    """The verdicts, in the order in which the logs were given, and the report on all together."""
    found = {
        "logs": [verdict.as_dict() for verdict in page.verdicts],
        "system": None if page.system is None else page.system.as_dict(),
    }
    told: dict[str, Json] = _renamed(page, found)
    return told


def _renamed(page: Page, value: Json) -> Json:
    was, name = page.renamed
    if not was:
        return value
    if isinstance(value, dict):
        return {key: _renamed(page, item) for key, item in value.items()}
    if isinstance(value, list):
        return [_renamed(page, item) for item in value]
    return value.replace(was, name) if isinstance(value, str) else value


def _log(page: Page, i: int, row_of: dict[Node, int]) -> dict[str, Json]:
    log = page.logs[i]
    return {
        "station": log.header.station,
        "file": log.file,
        "header": log.header.model_dump(mode="json", by_alias=True, exclude_none=True),
        "end": "no end" if log.end is None else log.end.reason,
        "why_not": page.followed[i].why_not,
        "diverges": _divergence(page, i, row_of),
        "ahead": _ahead(page.merged, i),
    }


def _divergence(page: Page, i: int, row_of: dict[Node, int]) -> int:
    """The row where a log diverges or stops being understood; -1 if nowhere."""
    log = page.logs[i]
    verdict = next(v for v in page.verdicts if v.file == log.file)
    if verdict.verdict == "allowed" or not verdict.line or not log.events:
        return -1
    before = [k for k, (at, _) in enumerate(log.events) if at <= verdict.line]
    exact = bool(before) and log.events[before[-1]][0] == verdict.line
    return row_of[i, before[-1]] if exact and verdict.verdict == "diverges" else -1


def _ahead(merged: Merged, i: int) -> int:
    """How many ms the clock of a log is most likely ahead of the first one's."""
    if len(merged.logs) == 1:
        return 0
    span = Clocks(merged).ahead(0, i)
    return 0 if span is None else span.best


def _rows(page: Page, strings: Table, shapes: Shapes) -> dict[str, Json]:
    """The columns of the table of rows; ``viewer/data.js`` says what each is."""
    texts, bodies = Table(), Table()
    n = len(page.logs)
    lines, times, sessions = [1] * n, 0, [""] * n
    after_cam = [False] * n
    found: dict[str, list[int]] = {
        name: [] for name in ("log", "line", "t", "text", "body", "session", "hint", "flags")
    }
    kinds = []
    for i, k in page.nodes:
        at, event = page.logs[i].events[k]
        m = event.message if isinstance(event, Send | Receive) else None
        flags = OF_CAM | IS_CAM if m is not None and m["type"] == "CAM" else 0
        if not flags and after_cam[i] and isinstance(event, TimerArm | TimerEnd):
            flags = OF_CAM * (event.timer.name == "cam" and event.op != "expire")
        after_cam[i] = bool(flags)
        named = session_of(event)
        if named is not None:
            sessions[i] = f"{named[0]}/{named[1]}"
        elif event.ev not in ("timer", "indication"):
            sessions[i] = ""
        hint = [event.rule or "", event.phase or "", event.role or ""]
        found["log"].append(i)
        found["line"].append(at - lines[i] - 1)
        found["t"].append(event.t_ms - times)
        found["text"].append(texts.back(said(event)))
        body = shapes.pack(_body(event))
        found["body"].append(bodies.back(body, json.dumps(body)))
        found["session"].append(strings.place(sessions[i]))
        found["hint"].append(strings.place(hint))
        found["flags"].append(flags)
        kinds.append("x" if event.ev == "restart" else event.ev[0])
        lines[i], times = at, event.t_ms
    columns: dict[str, Json] = {name: _folded(column) for name, column in found.items()}
    return columns | {"kinds": "".join(kinds), "texts": texts.values, "bodies": bodies.values}


def _folded(column: list[int]) -> Json:
    """A column of one value only as that value."""
    return column[0] if column and len(set(column)) == 1 else column


def _body(event: Event) -> dict[str, Json]:
    """What only this kind of event has, as it was logged; a deadline from ``t_ms`` on."""
    common = {"rec", "seq", "t_ms", "ev", "rule", "phase", "role"}
    body = {
        name: value
        for name, value in event.model_dump(mode="json", exclude_none=True).items()
        if name not in common
    }
    if isinstance(event, TimerArm):
        body["deadline"] = event.deadline - event.t_ms
    return body


def _arrows(page: Page, row_of: dict[Node, int]) -> list[int]:
    """Five numbers each: how many rows below the one before it leaves, what became of it, how many
    rows further down it arrives (0: nowhere), the column it leaves from and the one it goes to;
    -1 is the column of all who have none."""
    merged = page.merged
    deliveries = Deliveries(merged, Clocks(merged))
    columns = {s: c for c, s in enumerate([*merged.stations, *page.ghosts])}
    found: list[tuple[int, int, int, int, int]] = []
    alone = len(page.logs) == 1
    for d in deliveries.all:
        row, to = row_of[d.sent], columns.get(d.to, -1)
        if not d.received:
            found.append((row, KINDS[d.outcome], 0, d.sent[0], to))
        for n, node in enumerate(d.received):
            kind = DUPLICATE if n else DELIVERED
            found.append((row, kind, row_of[node] - row, d.sent[0], to))
    for row, (i, _) in enumerate(page.nodes):
        event = page.event(row)
        if alone and isinstance(event, Send) and not event.message.get("dst"):
            found.append((row, UNOBSERVED, 0, i, -1))
        elif isinstance(event, Receive) and page.nodes[row] not in merged.matches:
            src = (event.message or {}).get("src")
            column = columns.get(src, -1) if type(src) is int else -1
            found.append((row, UNSENT, 0, column, i))
    forged = {row_of[f.at] for f in deliveries.forged}
    found.sort()
    numbers, last = [], 0
    for row, kind, down, source, to in found:
        kind = FORGED if kind == UNSENT and row in forged else kind
        numbers += [row - last, kind, down, source, to]
        last = row
    return numbers


def _bars(page: Page, row_of: dict[Node, int]) -> list[int]:
    """Five numbers each: how many rows below the one before the timer is armed, how many rows
    further down it ends (0: never), how it ends, how many ms it was to run as logged, and how many
    more as specified; if nobody says that, -1000000."""
    found = []
    for i, followed in enumerate(page.followed):
        for bar in followed.bars:
            row = row_of[i, bar.armed]
            down = row_of[i, bar.ended] - row if bar.ended >= 0 else 0
            more = bar.spec_ms - bar.logged_ms if bar.spec_ms >= 0 else -1_000_000
            found.append((row, down, bar.how, bar.logged_ms, more))
    found.sort()
    numbers, last = [], 0
    for row, *rest in found:
        numbers += [row - last, *rest]
        last = row
    return numbers


def _steps(followed: Followed, strings: Table) -> dict[str, Json]:
    lines = [b - a for a, b in zip([0, *followed.steps], followed.steps, strict=False)]
    where = [strings.place([rule, *place]) for rule, place in _decisions(followed)]
    return {"lines": lines, "where": where, "states": _sparse(followed.states)}


def _decisions(followed: Followed) -> list[tuple[str, tuple[str, int]]]:
    return list(zip(followed.rules, followed.places, strict=True))


def _sparse(states: list[Json]) -> list[Json]:
    """States as ``place, change`` in turns, without those that change nothing."""
    return [part for n, change in enumerate(states) if change for part in (n, change)]


def _used(followed: Sequence[Followed]) -> dict[str, Json]:
    """The operators of Station.tla that decided a step: the first line, and the text."""
    known = operators(TLA)
    wanted: set[str] = set()
    for f in followed:
        for name, line in set(f.places):
            wanted.add(name)
            around = [o for o, (first, _) in known.items() if first <= line]
            wanted |= set(around[-1:]) if line else set()
    return {name: [known[name][0], known[name][1].rstrip()] for name in sorted(wanted & set(known))}
