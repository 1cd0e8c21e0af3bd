"""The page: its data is exact, its text stays text, and it needs nothing else."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import shutil
import subprocess
from itertools import accumulate
from pathlib import Path

import pytest
from merged_runs import records, rewritten, simulated
from page_rows import CORPUS, FOUR, Json, column, data_of, events, fives, followed_by, number

from automcm_spec.log_format.log import TimerArm
from automcm_spec.log_format.reader import read
from automcm_spec.support.bad_input import BadInput
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.checker.engine import Engine
from automcm_traces.explain.explain import verdicts_of
from automcm_traces.explain.log_table import Filter, Logs, folds
from automcm_traces.export.itf_log import from_log
from automcm_traces.viewer import page_run
from automcm_traces.viewer.page import SCRIPTS, VIEWER, html
from automcm_traces.viewer.page_data import IS_CAM, OF_CAM, as_dict, load, of_runs
from automcm_traces.viewer.page_follow import EXPIRED, RESTARTED
from automcm_traces.viewer.page_pack import compact

HOSTILE = "|</script><img src=x onerror=alert(1)>\u202e\u0007\u2028\u05e9\u05dc"


@pytest.mark.parametrize("more", ["", '{"rec":"event"}\n', FOUR[0].read_text().split("\n", 1)[1]])
def test_the_script_begins_also_without_an_event(more: str, tmp_path: Path) -> None:
    if not (node := shutil.which("node")):
        pytest.skip("node is not installed")
    log = tmp_path / "log.ndjson"
    log.write_text(FOUR[0].read_text().split("\n", 1)[0] + "\n" + more)
    for page in (html(load([log])), html(of_runs(page_run.load([log]), page_run.load([log])))):
        data, script = re.findall(r"<script[^>]*>(.*?)</script>", page.decode(), re.S)
        run = [node, Path(__file__).parents[1] / "page_in_node.js"]
        given = f"{data}\n---\n{script}"
        done = subprocess.run(run, input=given, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def test_fields_of_a_vendor_are_there_as_they_were_logged(tmp_path: Path) -> None:
    lines = records(FOUR[0])
    lines[0]["implementation"]["x_build"] = 7
    arm = next(r for r in lines if r.get("op") == "arm")
    arm["x_cause"] = {"x_deep": ["a"]}
    arm["timer"]["x_slot"] = 3
    next(r for r in lines if r.get("message", {}).get("type") == "CAM")["x_rssi"] = -60
    rewritten(tmp_path / "a.ndjson", lines)
    data = data_of(html(load([tmp_path / "a.ndjson"])))
    assert data["logs"][0]["header"] == records(tmp_path / "a.ndjson")[0]
    assert [event for *_, event in events(data)] == records(tmp_path / "a.ndjson")[1:-1]


@pytest.mark.parametrize("path", FOUR + sorted((CORPUS / "pair").glob("*.ndjson")))
def test_the_states_are_those_of_the_specification(path: Path) -> None:
    """As many and the same as in the log's ITF."""
    followed = followed_by(read(path))
    itf = json.loads(from_log(read(path)))["states"][1:]
    assert [s["#meta"]["line"] for s in itf] == followed.steps
    for n, state in enumerate(itf):
        mine = followed.state(n)
        for name in ("phase", "role", "deciding", "quarantine", "backoff"):
            assert mine[name] == state[name], (n, name)
        assert len(mine["outbox"]) == len(state["outbox"]["#set"])
        assert mine["recorded"] == sorted(map(number, state["recorded"]["#set"]))
    assert len(followed.states) == len(followed.decided) == len(itf)
    assert all(set(s) == set(followed.states[0]) for s in followed.states[::100])


@pytest.mark.parametrize("path", FOUR)
def test_the_deadline_beside_a_timer_is_that_of_the_specification(path: Path) -> None:
    log = read(path)
    engine, due = Engine(log.header), {}
    for n, (at, event) in enumerate(log.events):
        engine.feed(at, event)
        if isinstance(event, TimerArm):
            due[n] = engine.timers[event.timer].first - event.t_ms
    bars = followed_by(log).bars
    assert {bar.armed for bar in bars} == set(due)
    for bar in bars:
        told = bar.spec_ms >= 0
        event = log.events[bar.armed][1]
        assert isinstance(event, TimerArm)
        assert told == (event.timer.name not in ("backoff", "forget"))
        assert not told or bar.spec_ms == due[bar.armed] == bar.logged_ms
    assert EXPIRED in {bar.how for bar in bars}


def test_a_wrong_deadline_stands_beside_the_right_one() -> None:
    data = data_of(html(load([CORPUS / "bad" / "window_too_long.ndjson"])))
    wrong = [(ms, more) for _, _, _, ms, more in fives(data["bars"]) if more not in (0, -1_000_000)]
    assert len(wrong) == 1 and wrong[0][1] < 0


def test_a_restart_ends_all_timers_but_the_quarantine(tmp_path: Path) -> None:
    lines = records(FOUR[0])
    at = next(n for n, r in enumerate(lines) if r.get("op") == "arm") + 1
    restart = {"rec": "event", "t_ms": lines[at - 1]["t_ms"], "ev": "restart"}
    log = rewritten(tmp_path / "a.ndjson", [*lines[:at], restart, lines[-1]])
    assert [bar.how for bar in followed_by(log).bars] == [RESTARTED]


def test_what_the_header_does_not_tell_has_no_deadline(tmp_path: Path) -> None:
    lines = records(FOUR[0])
    del lines[0]["parameters"]["t_giveup"]
    log = rewritten(tmp_path / "a.ndjson", lines)
    named = {log.events[bar.armed][1].timer.name: bar.spec_ms for bar in followed_by(log).bars}  # type: ignore[union-attr]
    assert named["giveup"] == -1 and named["advertise"] > 0


def test_act_6_a_quarantine_lasts_as_long_as_a_prescriber_may_act(tmp_path: Path) -> None:
    """With few sendings that is longer than an Advertisement is heard, 300 ms."""
    short, restarts = Parameters(t_timeout=0), {1001: 100}
    (path,) = simulated(tmp_path, 1001, asks=(), restarts=restarts, until=5000, parameters=short)
    bars = followed_by(read(path)).bars
    assert [(bar.logged_ms, bar.spec_ms) for bar in bars] == [(1550, 1550)]


BAD = [e for e in json.loads((CORPUS / "index.json").read_text()) if e["file"].startswith("bad/")]


@pytest.mark.sweep(20)
@pytest.mark.parametrize("entry", BAD, ids=[e["file"] for e in BAD])
def test_the_verdict_is_that_of_explain_and_its_row_is_marked(entry: Json) -> None:
    path = CORPUS / entry["file"]
    try:
        data = data_of(html(load([path])))
    except BadInput:
        assert entry["verdict"] == "unreadable"
        return
    (told,) = verdicts_of([path])
    assert data["runs"][0]["verdicts"] == [json.loads(json.dumps(told.as_dict()))]
    row = data["logs"][0]["diverges"]
    if told.verdict == "diverges":
        assert events(data)[row][1] == told.finding.at.line
    else:
        assert row == -1


@pytest.mark.parametrize("path", [*FOUR, CORPUS / "pair" / "1001.ndjson"], ids=lambda p: p.name)
def test_a_page_folds_the_rows_that_show_folds_and_copies_of_other_fates(path: Path) -> None:
    """``show`` says the fate of each row, a page how many of the copies were lost."""
    rows = as_dict(load([path]))["rows"]
    copy, flags = column(rows, "copy"), column(rows, "flags")
    lines = list(accumulate(column(rows, "line"), lambda a, b: a + b + 1))
    kept = [n for n, line in enumerate(lines) if not copy[n] and not flags[n] & OF_CAM]
    shown = folds(Logs([path]).filtered(Filter()))
    heads = {fold.first.line for fold in shown if fold.first.event}
    assert 0.5 * len(heads) < len(kept) and {lines[n] + 2 for n in kept} <= heads


def test_the_operators_that_decided_are_there_and_no_others() -> None:
    data = data_of(html(load(FOUR[:1])))
    used = {data["strings"][n][1] for n in data["steps"][0]["where"]}
    assert used and used <= set(data["operators"])
    for name, (first, text) in data["operators"].items():
        tla = (Path(__file__).parents[3] / "spec/tla/Station.tla").read_text().splitlines()
        assert tla[first - 1].startswith(name) and text.startswith(tla[first - 1])


def test_a_cam_and_the_timer_it_arms_anew_are_marked() -> None:
    data = data_of(html(load(FOUR)))
    flags = column(data["rows"], "flags")
    for flag, (_, _, event) in zip(flags, events(data), strict=True):
        is_cam = event.get("message", {}).get("type") == "CAM"
        assert bool(flag & IS_CAM) == is_cam
        if flag & OF_CAM and not is_cam:
            assert event["timer"]["name"] == "cam"


# -- foreign text


def with_text(folder: Path, text: str) -> Path:
    """A log that holds ``text`` wherever it can."""
    lines = records(FOUR[0])
    lines[0]["implementation"]["name"] = lines[0]["run"] = text
    lines[1] |= {"rule": text, "phase": text}
    odd = {"v": 1, "src": 7, "type": text, text: [text, {text: text}]}
    extra = {"rec": "event", "t_ms": 0, "ev": "receive", "tx": "7:1", "message": odd}
    path = folder / "odd.ndjson"
    rewritten(path, [lines[0], extra, *lines[1:]])
    return path


def test_foreign_text_cannot_become_markup(tmp_path: Path) -> None:
    page = html(load([with_text(tmp_path, HOSTILE)]))
    plain = html(load([with_text(tmp_path, "plain")]))
    for tag in (b"<script", b"</script", b"<img", b"<!--"):
        assert page.count(tag) == plain.count(tag), tag
    assert b"\x07" not in page and "\u202e".encode() not in page
    assert HOSTILE in {event.get("rule") for *_, event in events(data_of(page))}


def test_a_script_cannot_be_ended_from_within() -> None:
    assert compact({"</script>": "<!--"}) == '{"\\u003c/script>":"\\u003c!--"}'


def test_a_field_of_100_000_characters_is_there_once(tmp_path: Path) -> None:
    page = html(load([with_text(tmp_path, "a" * 100_000)]))
    assert len(page) < 2_000_000
    assert page.count(b"a" * 1000 + b"<") == 0  # cut in the table, and in titles


@pytest.mark.slow
def test_10_000_stations_share_a_column(tmp_path: Path) -> None:
    lines = records(FOUR[0])
    cams = [
        {
            "rec": "event",
            "t_ms": 0,
            "ev": "receive",
            "tx": f"{station}:1",
            "message": {"v": 1, "src": station, "type": "CAM", "generation_ms": 0, "x_mm": 0}
            | {"y_mm": 0, "heading_mrad": 0, "speed_mm_s": 0, "marks": []},
        }
        for station in range(10_001, 20_001)
    ]
    rewritten(tmp_path / "a.ndjson", [lines[0], *cams, *lines[1:]])
    page = html(load([tmp_path / "a.ndjson"]))
    data = data_of(page)
    assert data["runs"][0]["crowded"] and data["runs"][0]["ghosts"] == []
    assert len(page) < 250 * len(data["rows"]["kinds"]) + 200_000


def test_the_policy_lets_only_this_script_and_style_run() -> None:
    page = html(load(FOUR[:1])).decode()
    found = re.search(r'Policy" content="([^"]*)"', page)
    assert found is not None
    policy = found[1].replace("&#39;", "'")
    assert policy.startswith("default-src 'none'; ")
    assert "unsafe" not in policy and "http" not in policy
    for tag, name in (("script", "script-src"), ("style", "style-src")):
        inline = re.search(rf"<{tag}>(.*?)</{tag}>", page, re.S)
        assert inline is not None
        digest = base64.b64encode(hashlib.sha256(inline[1].encode()).digest()).decode()
        assert f"{name} 'sha256-{digest}'" in policy
    outside = re.sub(r"http://www.w3.org/2000/svg", "", page)
    assert not re.search(r'(src|href)="|https?://|@import|url\(', outside)


def declared(line: str) -> list[str]:
    """The names that a line of JavaScript declares at the top level."""
    found = re.match(r"(?:async )?(const|let|var|class|function\*?) +(.*)", line)
    if found is None:
        return []
    if several := re.match(r"[\[{]([\w$, ]*)[\]}]", found[2]):
        return re.findall(r"[\w$]+", several[1])
    rest, last = found[2], ""
    while rest != last:  # without what is in brackets
        rest, last = re.sub(r"\([^()]*\)|\[[^\[\]]*\]|\{[^{}]*\}", "", rest), rest
    names = re.findall(r"(?:^|, )([\w$]+) =(?![=>])", rest)
    return names or re.findall(r"^[\w$]+", rest)


def test_the_scripts_declare_each_name_once() -> None:
    """They become one script, which does not start if two of them declare a name."""
    where: dict[str, list[str]] = {}
    for script in SCRIPTS:
        for line in (VIEWER / script).read_text().splitlines():
            for name in declared(line):
                where.setdefault(name, []).append(script)
    assert len(where) > 250
    assert where["LANE"] == ["layout.js"] and where["FORGED"] == ["data.js"]
    assert {name: found for name, found in where.items() if len(found) > 1} == {}


def test_without_javascript_there_is_a_table_of_all_rows() -> None:
    page = load(FOUR)
    text = html(page).decode()
    table = re.search(r"<noscript>(.*?)</noscript>", text, re.S)
    assert table is not None
    assert table[1].count("<tr><td>") == len(page.nodes)
    assert f"{FOUR[0]}: ALLOWED" in table[1]
