"""The data of a page as compact JSON: ordered rows, arrows, timer bars, states, verdicts.

``viewer/data.js`` reads it and documents each part.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

from automcm_spec.log_format.event_text import session_of, summary
from automcm_spec.log_format.log import RECORD, Event, Receive, TimerArm
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary.rules import RULES, operators
from automcm_traces.explain.hints import cause_of
from automcm_traces.explain.log_table import Phases
from automcm_traces.system.copy_folding import Key, OfCams, folded, key_of
from automcm_traces.system.event_order import Head, Node, Ordered
from automcm_traces.system.fates import FATES, Arrow, Fates
from automcm_traces.viewer import page_run, page_traffic
from automcm_traces.viewer.page_compare import Comparison, compare
from automcm_traces.viewer.page_follow import StateHistory
from automcm_traces.viewer.page_pack import PackedTable, Shapes
from automcm_traces.viewer.page_part import PagePart
from automcm_traces.viewer.page_run import PageRun

Json = Any
OF_CAM = 1
"""A CAM, or the timer that it re-arms."""
IS_CAM = 2
BESIDE = 4
"""It shares a row with the previous event, which belongs to the other run."""


@dataclass(slots=True)
class Page:
    """The content of one page: a run, or two side by side."""

    title: str
    runs: list[PageRun]
    nodes: list[Node]
    """Its events in order: the index of the log among those of all runs, and of the event in it."""
    ahead: list[int]
    """For each log, how many ms its clock is ahead of the first one."""
    beside: set[int] = field(default_factory=set)
    """The indices in ``nodes`` of events that share a row with the previous one."""
    comparison: Comparison | None = None
    note: str = ""
    """A remark on the verdict, in a sentence."""
    traffic: Path | None = None
    """A file with the positions of all road users (docs/trace-format.md)."""
    logs: list[Log] = field(init=False)
    histories: list[StateHistory] = field(init=False)

    def __post_init__(self) -> None:
        self.logs = [log for run in self.runs for log in run.logs]
        self.histories = [history for run in self.runs for history in run.histories]

    def name(self, i: int) -> str:
        """The station of a log, with its run if there are two."""
        run = "" if len(self.runs) == 1 else "A · " if i < len(self.runs[0].logs) else "B · "
        return f"{run}{self.logs[i].header.station}"


def load(
    paths: Sequence[Path], title: str = "", late_ms: int | None = None, part: PagePart | None = None
) -> Page:
    """A page of the logs of one run. Raises the exceptions of ``page_run.load``."""
    return of_runs(page_run.load(paths, late_ms, part), title=title)


def of_runs(
    a: PageRun, b: PageRun | None = None, stations: Mapping[int, int] | None = None, title: str = ""
) -> Page:
    """A page of one run or of two; ``stations`` is as for ``diff``.

    Raises PageError if there is no station to compare.
    """
    note = " ".join(run.note for run in (a, b) if run is not None and run.note)
    comparison = None if b is None else compare(a, b, stations)
    runs = [a] if b is None else [a, b]
    ahead = a.merged.clocks.offsets() if comparison is None else comparison.ahead
    title = title or " | ".join(run.title for run in runs)
    page = Page(title, runs, [], ahead, comparison=comparison, note=note)
    beside = {} if comparison is None else comparison.beside
    feeds = [
        _feed(run, fates, i, first, b is not None)
        for run, first in zip(runs, [0, len(a.logs)], strict=False)
        for fates in [Fates(run.merged.matches)]
        for i in range(len(run.logs))
    ]
    for nodes in Ordered(feeds, ahead, beside):
        page.nodes += nodes
        if len(nodes) == 2:
            page.beside.add(len(page.nodes) - 1)
    return page


def _feed(run: PageRun, fates: Fates, i: int, first: int, compared: bool) -> Iterator[Head[Node]]:
    """The events of a log of a run whose first log has index ``first``. Where two runs are
    ``compared``, which leaves out CAMs, the rows of others may contradict their order."""
    for (_, k), _, t_ms, needs, sure, _ in run.merged.feed(i, fates):
        node = first + i, k
        sure = sure and not (compared and run.logs[i].events[k][1].is_cam)
        yield Head(node, node, t_ms, needs and (first + needs[0], needs[1]), sure)


def as_dict(page: Page) -> dict[str, Json]:
    """All data of the page, as ``viewer/data.js`` reads it."""
    strings, shapes = PackedTable(), Shapes()
    arrows = [list(run.merged.arrows()) for run in page.runs]
    rows = _rows(page, strings, shapes, _rejected(page, arrows))
    row_of = {node: row for row, node in enumerate(page.nodes)}
    steps = [_steps(f, strings) for f in page.histories]
    rules = {rule for f in page.histories for rule, *_ in f.decided}
    return {
        "title": page.title,
        "note": page.note,
        "runs": [_run(run) for run in page.runs],
        "compared": _compared(page, row_of),
        "logs": _logs(page, row_of),
        "rows": rows,
        "arrows": _arrows(page, row_of, arrows),
        "rejected": _causes(page.logs),
        "bars": _bars(page, row_of),
        "steps": steps,
        "operators": _used(page.histories),
        "rules": {rule: RULES.get(rule, "") for rule in sorted(rules)},
        "strings": strings.values,
        "shapes": list(shapes.keys),
        "traffic": page_traffic.of(page.traffic, page.nodes, page.logs),
    }


def judged(page: Page) -> dict[str, Json]:
    """The verdicts in the order of the given logs, and the report on all logs together; for two
    runs also those of B, and the ``diff``."""
    found = page.runs[0].judged()
    if page.comparison is not None:
        found |= {"b": page.runs[1].judged(), "diff": page.comparison.diff.as_dict()}
    return found


def _run(run: PageRun) -> dict[str, Json]:
    judged_run = run.judged()
    return {
        "verdicts": judged_run["logs"],
        "system": judged_run["system"],
        "hazards": [hazard.text() for hazard in run.system.hazards] if run.system else [],
        "ghosts": run.ghosts,
        "crowded": run.crowded,
        "counterexample": run.counterexample,
    }


def _compared(page: Page, row_of: dict[Node, int]) -> Json:
    """The ``diff`` of the runs. For each station it adds its two logs and the row of the first
    difference (-1: none). ``first`` is the station whose row comes first (-1: none differs)."""
    made = page.comparison
    if made is None:
        return None
    found: Json = made.diff.as_dict()
    rows = [min((row_of[node] for node in end if node), default=-1) for end in made.ends]
    for one, logs, row in zip(found["stations"], made.logs, rows, strict=True):
        one |= {"logs": logs, "row": row}
    differ = [n for n, row in enumerate(rows) if row >= 0]
    found["first"] = min(differ, key=lambda n: rows[n], default=-1)
    return found


def _logs(page: Page, row_of: dict[Node, int]) -> list[Json]:
    found: list[Json] = []
    for n, run in enumerate(page.runs):
        first = len(found)
        for i, (log, history) in enumerate(zip(run.logs, run.histories, strict=True)):
            no_end = "goes on" if run.note else "no end"
            found.append(
                {
                    "run": n,
                    "station": log.header.station,
                    "file": log.file,
                    "header": run.vendor[log.file].get(1) or _plain(log.header),
                    "end": no_end if log.end is None else log.end.reason,
                    "why_not": history.why_not,
                    "due": history.due,
                    "diverges": _divergence(run, i, first, row_of),
                    "ahead": page.ahead[first + i],
                    "before": log.events[0][1].seq - 1 if log.events else 0,  # the part shown
                }
            )
    return found


def _divergence(run: PageRun, i: int, first: int, row_of: dict[Node, int]) -> int:
    """The row where a log diverges; -1 if there is none. ``first`` is the index of the run's first
    log."""
    log = run.logs[i]
    verdict = next(v for v in run.verdicts if v.file == log.file)
    if verdict.verdict != "diverges":
        return -1
    at = next((k for k, (line, _) in enumerate(log.events) if line == verdict.finding.at.line), -1)
    return row_of.get((first + i, at), -1)


def _rows(
    page: Page, strings: PackedTable, shapes: Shapes, rejected: Mapping[Node, Hashable]
) -> dict[str, Json]:
    """The columns of the row table, documented in ``viewer/data.js``."""
    texts, bodies = PackedTable(), PackedTable()
    logs, n = page.logs, len(page.logs)
    lines, times, sessions = [1] * n, 0, [""] * n
    of_cam, phases = OfCams(), Phases()
    keys: list[list[tuple[int, Key | None]]] = [[] for _ in page.runs]
    run_of = [r for r, run in enumerate(page.runs) for _ in run.logs]
    vendor = [run.vendor[log.file] for run in page.runs for log in run.logs]
    found: dict[str, list[int]] = {
        name: [] for name in ("log", "line", "t", "text", "body", "session", "hint", "flags")
    }
    kinds = []
    for row, (i, k) in enumerate(page.nodes):
        at, event = logs[i].events[k]
        flags = OF_CAM * of_cam.has(i, event) | IS_CAM * event.is_cam
        if not flags:
            changes = bool(phases.change(i, event))
            keys[run_of[i]].append((row, key_of(i, event, rejected.get((i, k)), changes)))
        named = session_of(event)
        if named is not None:
            sessions[i] = f"{named[0]}/{named[1]}"
        elif event.ev not in ("timer", "indication"):
            sessions[i] = ""
        hint = [event.rule or "", event.phase or "", event.role or ""]
        found["log"].append(i)
        found["line"].append(at - lines[i] - 1)
        found["t"].append(event.t_ms - times)
        found["text"].append(texts.back(summary(event)))
        body = shapes.pack(_body(event, vendor[i].get(at)))
        found["body"].append(bodies.back(body))
        found["session"].append(strings.place(sessions[i]))
        found["hint"].append(strings.place(hint))
        found["flags"].append(flags | BESIDE * (row in page.beside))
        kinds.append("x" if event.ev == "restart" else event.ev[0])
        lines[i], times = at, event.t_ms
    pairs = [_copies(of_run, len(page.nodes)) for of_run in keys]
    found["copy"] = [sum(backs) for backs in zip(*pairs, strict=True)]
    columns: dict[str, Json] = {  # a column with a single distinct value as that value
        name: column[0] if len({*column}) == 1 else column for name, column in found.items()
    }
    return columns | {"kinds": "".join(kinds), "texts": texts.values, "bodies": bodies.values}


_plain = partial(RECORD.dump_python, mode="json", by_alias=True, exclude_none=True)


def _body(event: Event, record: dict[str, Json] | None) -> dict[str, Json]:
    """The logged fields that only this kind of event has, with the vendor fields of ``record`` if
    given; a deadline is relative to ``t_ms``."""
    common = {"rec", "seq", "t_ms", "ev", "rule", "phase", "role"}
    record = record or _plain(event)
    body = {name: value for name, value in record.items() if name not in common}
    if isinstance(event, TimerArm):
        body["deadline"] = event.deadline - event.t_ms
    return body


def _rejected(page: Page, arrows: list[list[Arrow]]) -> dict[Node, frozenset[Arrow]]:
    """The rejections of the message of each event, without their places."""
    found: dict[Node, frozenset[Arrow]] = defaultdict(frozenset)
    first = 0
    for run, drawn in zip(page.runs, arrows, strict=True):
        for arrow in drawn:
            for node in (arrow.leaves, arrow.arrives):
                if arrow.fate == "rejected" and node is not None:
                    found[first + node[0], node[1]] |= {arrow.plain}
        first += len(run.logs)
    return found


def _copies(keys: list[tuple[int, Key | None]], count: int) -> list[int]:
    """By row, how many rows above is the one into which it is folded; 0 if it is not a copy."""
    found = [0] * count
    for fold in folded(keys, itemgetter(1), keep=True):
        for row, _ in fold.copies:
            found[row] = row - fold.first[0]
    return found


def _arrows(page: Page, row_of: dict[Node, int], arrows: list[list[Arrow]]) -> list[int]:
    """Five numbers per arrow: the rows from the previous arrow's start to its start, its fate as an
    index of FATES, the rows down to its end (0: none), and the columns it leaves and reaches. An
    arrow whose transmission is not logged starts at its reception. Column -1 is shared by all
    stations without a column. The columns are the logs of all runs, then their ghosts."""
    found: list[tuple[int, ...]] = []
    first, ghost = 0, len(page.logs)
    for run, drawn in zip(page.runs, arrows, strict=True):
        columns = {s: first + i for i, s in enumerate(run.merged.stations)}
        columns |= {s: ghost + n for n, s in enumerate(run.ghosts)}
        for arrow in drawn:
            rows = [row_of[first + at[0], at[1]] for at in (arrow.leaves, arrow.arrives) if at]
            if arrow.fate == "rejected" and rows[0] > rows[-1]:
                rows = rows[-1:]  # it cannot be the transmission that its tx names
            source, to = (columns.get(s, -1) for s in (arrow.source, arrow.to))
            down = max(0, rows[-1] - rows[0])
            found.append((rows[0], FATES.index(arrow.fate), down, source, to))
        first, ghost = first + len(run.logs), ghost + len(run.ghosts)
    return _from_row_to_row(found)


def _from_row_to_row(found: list[tuple[int, ...]]) -> list[int]:
    """All numbers in order; the first of each is its row, which counts from the one before."""
    numbers, last = [], 0
    for row, *rest in sorted(found):
        numbers += [row - last, *rest]
        last = row
    return numbers


def _causes(logs: Sequence[Log]) -> dict[str, str]:
    """By logged reason for which a message was rejected, what it means."""
    events = (event for log in logs for _, event in log.events)
    reasons = {e.rejected for e in events if isinstance(e, Receive) and e.rejected is not None}
    return {reason: cause_of(reason) for reason in sorted(reasons)}


def _bars(page: Page, row_of: dict[Node, int]) -> list[int]:
    """Five numbers per bar: the rows from the previous bar's start to its start, the rows down to
    its end (0: none), how it ends, its logged duration in ms, and the difference of the specified
    duration in ms, or -1000000 if that is unknown."""
    found: list[tuple[int, ...]] = []
    for i, history in enumerate(page.histories):
        for bar in history.bars:
            row = row_of[i, bar.armed]
            down = row_of[i, bar.ended] - row if bar.ended >= 0 else 0
            more = bar.spec_ms - bar.logged_ms if bar.spec_ms >= 0 else -1_000_000
            found.append((row, down, bar.how, bar.logged_ms, more))
    return _from_row_to_row(found)


def _steps(history: StateHistory, strings: PackedTable) -> dict[str, Json]:
    lines = [b - a for a, b in zip([0, *history.steps], history.steps, strict=False)]
    where = [strings.place(decided) for decided in history.decided]
    # States as alternating index and change, without empty changes.
    states = [part for n, change in enumerate(history.states) if change for part in (n, change)]
    return {"lines": lines, "where": where, "states": states}


def _used(histories: Sequence[StateHistory]) -> dict[str, Json]:
    """The operators of Station.tla that decided a step: the first line, and the text."""
    known = operators()
    wanted: set[str] = set()
    for f in histories:
        for _, name, line in set(f.decided):
            wanted.add(name)
            around = [o for o, (first, _) in known.items() if first <= line]
            wanted |= set(around[-1:]) if line else set()
    return {name: [known[name][0], known[name][1].rstrip()] for name in sorted(wanted & set(known))}
