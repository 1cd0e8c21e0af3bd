"""Show, page, Mermaid, SVG, ITF and MCAP show each arrow of the pipeline: in runs with loss,
copies, forged and rejected messages, no tx, and logs that stop."""

from __future__ import annotations

import json
import random
import re
import xml.etree.ElementTree as ElementTree
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from merged_runs import Run, killed, records, rewritten, without_tx
from page_rows import Json, events, fives

from automcm.links.simulated_radio import Channel
from automcm_maintenance.corpus.corpus_runs import secured
from automcm_spec.log_format.event_text import summary
from automcm_spec.log_format.log import Receive, Send
from automcm_spec.log_format.reader import read
from automcm_traces.explain.log_table import Logs, arrow_rows
from automcm_traces.export import mcap_file
from automcm_traces.export.itf_log import from_log
from automcm_traces.export.mermaid import diagram
from automcm_traces.export.svg_drawing import drawing
from automcm_traces.system.delivery import outcomes
from automcm_traces.system.fates import ANYONE, FATES
from automcm_traces.system.log_merge import merge
from automcm_traces.viewer.page_data import as_dict, load

SVG = "{http://www.w3.org/2000/svg}"
MARKS = {"lost": "x{to}", "in_flight": "?{to}", "duplicated": "2nd", "forged": "forged"}


class Seen(NamedTuple):
    """An arrow as a view shows it, at the line where it arrives or, if it does not, leaves."""

    station: int
    line: int
    source: int
    to: int
    fate: str
    """With the reason, if it was rejected."""


def named(fate: str, reason: str = "") -> str:
    return f"{fate}: {reason}" if reason else fate


class Case:
    """A run, and the arrows that all views must show."""

    def __init__(self, paths: list[Path]) -> None:
        self.paths = paths
        merged = merge([read(path) for path in paths])
        self.arrows: Counter[Seen] = Counter()
        self.cams: set[tuple[int, int]] = set()
        self.drawn: Counter[tuple[int, int, str]] = Counter()
        self.refused = sorted(
            (merged.stations[i], merged.logs[i].events[k][0], f"!{to}")
            for (i, k), to, outcome in outcomes(merged)
            if outcome == "rejected"
        )
        """The messages that their addressees rejected, at the lines where they leave."""
        for arrow in merged.arrows():
            node = arrow.arrives or arrow.leaves
            assert node is not None
            log = merged.logs[node[0]]
            at, event = log.events[node[1]]
            station = log.header.station
            self.arrows[
                Seen(station, at, arrow.source, arrow.to, named(arrow.fate, arrow.reason))
            ] += 1
            assert isinstance(event, Send | Receive)
            if event.message is not None and event.message["type"] == "CAM":
                self.cams.add((station, at))
            else:
                about = summary(merged.event(arrow.leaves or node))
                self.drawn[arrow.source, arrow.to, f"{about}: {arrow.word}"] += 1


def in_show(case: Case) -> Counter[Seen]:
    found: Counter[Seen] = Counter()
    refused = []
    for row in Logs(case.paths).rows():
        shown = row.as_dict()
        marks = []
        for arrow in shown["arrows"]:
            fate = named(arrow["fate"], arrow.get("reason", ""))
            found[Seen(row.station, row.line, arrow["from"], arrow["to"], fate)] += 1
            marks += [MARKS[arrow["fate"]].format(**arrow)] if arrow["fate"] in MARKS else []
        assert [note for note in shown["notes"] if note[:4] != "for " and note[0] != "!"] == marks
        refused += [(row.station, row.line, note) for note in shown["notes"] if note[0] == "!"]
    assert sorted(refused) == case.refused
    return found


def on_the_page(case: Case) -> Counter[Seen]:
    data = as_dict(load(case.paths))
    rows = events(data)
    columns = [log["station"] for log in data["logs"]] + data["runs"][0]["ghosts"] + [ANYONE]
    found: Counter[Seen] = Counter()
    for row, kind, down, source, to in fives(data["arrows"]):
        station, line, event = rows[row + down]
        fate = named(FATES[kind], event.get("rejected", ""))
        found[Seen(station, line, columns[source], columns[to], fate)] += 1
    return found


def in_mcap(case: Case) -> Counter[Seen]:
    reader = pytest.importorskip("mcap.reader")
    import io

    found: Counter[Seen] = Counter()
    stream = io.BytesIO(mcap_file.written(case.paths))
    for _, channel, message in reader.make_reader(stream).iter_messages():
        if channel.topic == mcap_file.ARROWS:
            a = json.loads(message.data)
            fate = named(a["fate"], a.get("reason", ""))
            found[Seen(a["station"], a["line"], a["from"], a["to"], fate)] += 1
    return found


def in_itf(case: Case) -> Counter[Seen]:
    found: Counter[Seen] = Counter()
    arrows = defaultdict(list)
    for path, row in arrow_rows(case.paths):
        arrows[path] += [(row.line, arrow) for arrow in row.arrows]
    for path in case.paths:
        log = read(path)
        text: Json = json.loads(from_log(log, arrows[path]))
        for state in text["states"]:
            for a in state["#meta"].get("messages", ()):
                place = (log.header.station, a["line"], a["from"], a["to"])
                found[Seen(*place, named(a["fate"], a.get("reason", "")))] += 1
    return found


def in_mermaid(case: Case, unfold: bool) -> Iterator[tuple[int, int, str]]:
    """Sender, addressee and fate of each message, in order."""
    heads = {"->>": "delivered", "-x": "lost", "-)": "in_flight", "--)": "unobserved"}
    heads["-->>"] = "sender_unobserved"
    said = {"duplicate": "duplicated", "in flight": "in_flight"}
    said |= {fate: fate for fate in ("forged", "overheard")}
    logs = Logs(case.paths)
    for line in diagram(logs.rows(), logs.stations, 10**9, unfold):
        mark = re.search(r" \u00d7(\d+)", line)
        line, times = re.sub(r" \u00d7\d+", "", line), int(mark[1]) if mark else 1
        assert times == 1 or not unfold
        arrow = re.match(r"  S(\d+)(-{1,2}(?:>>|x|\)))\s?S(\d+): .*?(?: \(([a-z ]+)\))?$", line)
        if arrow:
            fate = said.get(arrow[4] or "", heads.get(arrow[2], ""))
            if arrow[2] == "--x":
                fate = named(*line.rpartition(": ")[2].split(" "))
            yield from [(int(arrow[1]), int(arrow[3]), fate)] * times
        elif stopped := re.match(r"  Note over S(\d+): #lt;- rejected \w+ (\w+)$", line):
            yield from [(ANYONE, int(stopped[1]), named("rejected", stopped[2]))] * times
        elif anyone := re.match(r"  Note over S(\d+): (#lt;- no message|\w+ -#gt;all)", line):
            lost = anyone[2].startswith("#lt;")
            ends = (ANYONE, int(anyone[1])) if lost else (int(anyone[1]), ANYONE)
            yield from [(*ends, "sender_unobserved" if lost else "unobserved")] * times


def phases(case: Case, unfold: bool) -> list[str]:
    logs = Logs(case.paths)
    lines = diagram(logs.rows(), logs.stations, 10**9, unfold)
    return [line for line in lines if re.match(r"  Note over S\d+: = ", line)]


def in_svg(case: Case, unfold: bool) -> Counter[tuple[int, int, str]]:
    root = ElementTree.fromstring(
        drawing(merge([read(path) for path in case.paths]), unfold=unfold)
    )
    at: dict[float, int] = {}
    for name in root.iter(f"{SVG}text"):
        if name.get("class") == "name":
            at[float(name.get("x", ""))] = int(name.text or "")
    found: Counter[tuple[int, int, str]] = Counter()
    for group in root.iter(f"{SVG}g"):
        path = group[1].get("d", "")
        ends = re.match(r"M(\S+) \S+(?:L(\S+) |H(\S+))", path)
        assert ends is not None, path
        x, far = float(ends[1]), float(ends[2] or ends[3])
        way = 1 if far > x else -1
        source = at.get(x, at.get(x - 30 * way, ANYONE))
        to = at.get(far, at.get(far + 30 * way, ANYONE))
        about, _, times = (group[0].text or "").partition(" \u00d7")
        found[source, to, about] += int(times or 1)
        crossed = "l8 8m0 -8l-8 8" in ElementTree.tostring(group, "unicode")
        assert crossed == about.endswith(": lost")
    return found


VIEWS: dict[str, Callable[[Case], Counter[Seen]]] = {
    "show": in_show,
    "page": on_the_page,
    "mcap": in_mcap,
    "itf": in_itf,
}


def compare(case: Case) -> None:
    """Fails where a view shows other arrows."""
    for name, view in VIEWS.items():
        shown = view(case)
        assert shown == case.arrows, (name, shown - case.arrows, case.arrows - shown)
    expected = sorted((a.source, a.to, a.fate) for a in case.arrows.elements()
                      if (a.station, a.line) not in case.cams)  # fmt: skip
    for unfold in (False, True):
        assert in_svg(case, unfold) == case.drawn
        assert sorted(in_mermaid(case, unfold)) == expected
    assert phases(case, False) == phases(case, True)


def faulty(folder: Path) -> None:
    """Copies and losses, a log that stops, a message forged and one overheard."""
    chance = random.Random(3)
    run = Run(
        folder,
        channel=Channel(duplicate=0.5),
        drop=lambda s, d, m, now: chance.random() < 0.3,
    )
    run.logs(until=5_000)
    killed(folder / "2.ndjson", 3000)
    one, two, three = (records(folder / f"{n}.ndjson") for n in (1, 2, 3))
    got = [line for line in two if line.get("ev") == "receive"]
    got[3]["tx"] = "1:999999"
    got[5]["message"]["v"] = 9
    del got[7]["message"]
    got[7]["raw"] = "AAAA"
    rewritten(folder / "2.ndjson", two)
    sent = next(r for r in one if r.get("ev") == "send" and r["message"].get("dst") == 2)
    heard = {name: sent[name] for name in ("rec", "t_ms", "tx", "message")} | {"ev": "receive"}
    n = next(n for n, r in enumerate(three) if r.get("t_ms", 0) > sent["t_ms"])
    rewritten(folder / "3.ndjson", [*three[:n], heard, *three[n:]])


def unnamed(folder: Path) -> None:
    """No transmission is named, and the third log is not there."""
    Run(folder, channel=Channel(duplicate=0.5)).logs(until=5_000)
    (folder / "3.ndjson").unlink()
    for n in (1, 2):
        without_tx(folder / f"{n}.ndjson")


def attacked(folder: Path) -> None:
    """Signed messages; one of each five rejected ones names no transmission."""
    secured(folder)
    for path in folder.iterdir():
        lines = records(path)
        for line in [line for line in lines if "rejected" in line][2::5]:
            line.pop("tx", None)
        rewritten(path, lines)


REASONS = ("bad_signature", "replayed", "stale", "unknown_authority", "wrong_source")
MADE: dict[Callable[[Path], None], set[str]] = {
    faulty: {"delivered", "lost", "duplicated", "in_flight", "forged", "overheard"},
    unnamed: {"unobserved", "sender_unobserved", "duplicated"},
    attacked: {f"rejected: {reason}" for reason in REASONS},
}
"""Runs, and the fates of messages in them."""


@pytest.mark.parametrize("make", MADE, ids=lambda make: make.__name__)
def test_all_views_agree_on_runs_with_faults(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / "logs")
    case = Case(sorted((tmp_path / "logs").glob("*.ndjson")))
    compare(case)
    assert bool(case.refused) == (make is attacked)
    assert {arrow.fate for arrow in case.arrows} >= MADE[make]
