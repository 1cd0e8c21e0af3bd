"""How large a page may be, what cannot be shown, and parts of logs that are too long."""

from __future__ import annotations

import json
import tracemalloc
from collections import Counter
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from merged_runs import records, simulated
from page_rows import CORPUS, DELIVERED, FORGED, FOUR, LOST, Json, events, fives

from automcm_cli.trace import trace_html
from automcm_spec.log_format.event_text import session_of, summary
from automcm_spec.support.bad_input import BadInput
from automcm_traces.explain.explain import JudgedLog, verdict_of, verdicts_of
from automcm_traces.viewer import page_part, page_run
from automcm_traces.viewer.page import html
from automcm_traces.viewer.page_data import Page, as_dict, load
from automcm_traces.viewer.page_follow import StateHistory
from automcm_traces.viewer.page_part import MOST_EVENTS, PageError, PagePart
from automcm_traces.viewer.page_run import MOST_LOGS


@cache
def four() -> Page:
    """The whole page, which no test changes."""
    return load(FOUR)


@pytest.mark.slow
@pytest.mark.parametrize("sessions", [3, pytest.param(10, marks=pytest.mark.deep)])
def test_a_large_log_takes_less_than_250_bytes_an_event(tmp_path: Path, sessions: int) -> None:
    asks = range(500, sessions * 9000, 9000)
    logs = simulated(
        tmp_path, 1, 2, 3, seed=1, loss=0.1, target=2, asks=asks, until=sessions * 9000
    )
    for paths in (logs, logs[:1]):
        page = load(paths)
        fixed = len(html(load(FOUR[:1])))
        assert len(html(page)) - fixed < 250 * len(page.nodes)


def test_a_part_of_many_logs_leaves_room_for_busier_stations() -> None:
    part = page_part.around([JudgedLog(FOUR[0], verdict_of(FOUR[0]))] * 50)[1]
    assert 0.5 < 50 * part.last / MOST_EVENTS < 0.52


@pytest.mark.parametrize("name", ["seq_gap", "rubbish_inside", "cut", "mixed_versions"])
def test_a_damaged_log_is_shown_up_to_the_damage(name: str) -> None:
    page = load([CORPUS / "bad" / f"{name}.ndjson"])
    assert page.nodes and html(page)


def test_beside_a_log_a_file_that_is_none_has_a_verdict(tmp_path: Path) -> None:
    (tmp_path / "rubbish").write_bytes(bytes(range(256)))
    data = as_dict(load([FOUR[0], tmp_path / "rubbish"]))
    assert [v["verdict"] for v in data["runs"][0]["verdicts"]] == ["allowed", "unreadable"]
    assert len(data["logs"]) == 1


def test_what_cannot_be_shown_is_said(tmp_path: Path) -> None:
    with pytest.raises(PageError, match="station 1001, as is"):
        load([FOUR[0], FOUR[0]])
    with pytest.raises(PageError, match="of run"):
        load([FOUR[0], CORPUS / "pair" / "2002.ndjson"])
    with pytest.raises(PageError, match=f"at most {MOST_LOGS}"):
        load(FOUR * 100)
    with pytest.raises(BadInput, match="no such file"):
        load([tmp_path / "nothing"])


# -- a part of logs that are too long


def restarts(path: Path, number: int, padding: int = 0, station: int = 7) -> Path:
    """A long log in which little happens."""
    header = records(FOUR[0])[0] | {"station": station, "x_vendor": "kept"}
    with path.open("w") as out:
        out.write(json.dumps(header) + "\n")
        for n in range(1, number + 1):
            event = {"rec": "event", "seq": n, "t_ms": 8 * n, "ev": "restart"}
            out.write(json.dumps(event | {"x_padding": "x" * padding}) + "\n")
        end = {"rec": "end", "seq": number, "reason": "clean", "lost_records": 0}
        out.write(json.dumps(end) + "\n")
    return path


def test_as_many_events_as_are_allowed_are_shown_and_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    number = len(four().nodes)
    monkeypatch.setattr(page_part, "MOST_EVENTS", number)
    assert len(load(FOUR).nodes) == number
    monkeypatch.setattr(page_part, "MOST_EVENTS", number - 1)
    page = load(FOUR)
    assert 0 < len(page.nodes) < number
    lines = sum(len(records(path)) for path in FOUR)
    assert f"{len(FOUR)} logs: {lines:,} lines; a page shows at most {number - 1:,}" in page.note
    options = ("--session", "--from-ms", "--to-ms", "--from-line", "--to-line")
    assert all(option in page.note for option in options)
    with pytest.raises(PageError, match="--session"):
        page_run.check_size(FOUR)


def test_the_bound_is_the_one_that_is_told() -> None:
    page = (Path(__file__).parents[3] / "docs/trace-format.md").read_text()
    for text in (page, str(trace_html.html.__doc__)):
        assert f"{MOST_EVENTS:,} events" in " ".join(text.split())


def test_as_many_bytes_as_are_allowed_are_shown_and_no_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(page_part, "MOST_BYTES", FOUR[0].stat().st_size)
    assert load(FOUR[:1]).nodes
    monkeypatch.setattr(page_part, "MOST_BYTES", FOUR[0].stat().st_size - 1)
    assert "a page shows at most 0 MiB. Choose a part" in load(FOUR[:1]).note


def peak(work: Callable[[], object]) -> int:
    """The most bytes in memory at once."""
    tracemalloc.start()
    work()
    found = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return found


@pytest.mark.slow
def test_of_a_log_that_is_too_long_only_a_part_is_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_part, "WINDOW", 100)
    monkeypatch.setattr(page_part, "MOST_EVENTS", 50_000)
    path = restarts(tmp_path / "7.ndjson", 50_001, padding=200)
    assert peak(lambda: load([path])) < path.stat().st_size / 5


@pytest.mark.slow
def test_a_part_takes_memory_for_the_part_alone(tmp_path: Path) -> None:
    short, long = (
        [restarts(tmp_path / f"{n}-{s}.ndjson", n, station=s) for s in (7, 8)] for n in (1000, 8000)
    )
    part = PagePart(501, 600)
    load(short, part=part)  # what is kept from the first time on
    one, other = (peak(lambda: load(short, part=part)), peak(lambda: load(long, part=part)))
    # What the collector has left to be freed differs from run to run by half of a part.
    assert other < 2 * one and peak(lambda: load(long)) > 20 * other


def test_a_part_may_not_be_too_long_either(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = restarts(tmp_path / "7.ndjson", 300)
    monkeypatch.setattr(page_part, "MOST_EVENTS", 100)
    assert len(load([path]).nodes) == 99  # lines 1 to 100
    assert len(load([path], part=PagePart(50, 149)).nodes) == 100
    with pytest.raises(PageError, match="more than 100 events in this part"):
        load([path], part=PagePart(50, 150))
    with pytest.raises(PageError, match="no readable event in lines 400 to 500"):
        load([path], part=PagePart(400, 500))


def test_of_a_log_that_is_too_long_the_divergence_is_shown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With the states and the frame that the whole page has."""
    log = CORPUS / "bad" / "wrong_proposal.ndjson"
    whole = load([log])
    monkeypatch.setattr(page_part, "MOST_EVENTS", len(whole.nodes) - 1)
    monkeypatch.setattr(page_part, "WINDOW", 20)
    page = load([log])
    at = page.runs[0].verdicts[0].finding.at.line
    shown = [line for line, _ in page.logs[0].events]
    assert shown == list(range(at - 15, at + 5)) and at == 56
    assert events(as_dict(page))[as_dict(page)["logs"][0]["diverges"]][1] == at
    known = states(whole.histories[0])
    assert states(page.histories[0]) == {n: known[n] for n in known if n in shown}
    assert page.histories[0].why_not == whole.histories[0].why_not


def test_a_session_or_a_time_chooses_the_part(tmp_path: Path) -> None:
    logs = simulated(tmp_path, 1001, 2002, until=13_000, asks=(500, 7000), target=2002)
    whole = load(logs)
    naming = [n for n, e in whole.logs[0].events if session_of(e) == (1001, 2)]
    page = load(logs[::-1], part=PagePart(session=(1001, 2)))
    part = next(log for log in page.logs if log.header.station == 2002)
    of_2002 = [n for n, e in whole.logs[1].events if session_of(e) == (1001, 2)]
    assert [n for n, _ in part.events] == list(range(of_2002[0], of_2002[-1] + 1))
    assert naming and all(n > 100 for n in naming)
    stranger = restarts(tmp_path / "7.ndjson", 50)
    assert load([stranger, logs[1]], part=PagePart(session=(1001, 2))).logs[0].events == part.events
    page = load(logs, part=PagePart(from_ms=2000, to_ms=3000))
    start = whole.logs[0].events[0][1].t_ms
    wanted = [n for n, e in whole.logs[0].events if 2000 <= e.t_ms - start <= 3000]
    assert [n for n, _ in page.logs[0].events] == wanted and len(wanted) > 5
    with pytest.raises(PageError, match="the logs: no readable event of session 9/9"):
        load(logs, part=PagePart(session=(9, 9)))
    with pytest.raises(BadInput, match="no such file"):
        load([tmp_path / "nothing"], part=PagePart(session=(9, 9)))
    with pytest.raises(PageError, match="no readable event from 99,000 ms on"):
        load(logs, part=PagePart(from_ms=99_000))


def states(history: StateHistory) -> dict[int, Json]:
    """By line the station after the step."""
    return {line: history.state(n) for n, line in enumerate(history.steps)}


@pytest.mark.sweep(3)
@pytest.mark.parametrize("last", range(12, 20))
def test_a_part_shows_what_the_whole_page_shows_there(last: int) -> None:
    """Also where it ends within a step."""
    whole, first = four(), 5
    part = load([FOUR[1], FOUR[0], *FOUR[2:]], part=PagePart(first, last))
    assert [log.header.station for log in part.logs] == [log.header.station for log in whole.logs]
    own = next(n for n, log in enumerate(part.logs) if log.file == str(FOUR[1]))
    assert [line for line, _ in part.logs[own].events] == list(range(first, last + 1))
    rows = {(log.file, line): summary(e) for log in whole.logs for line, e in log.events}
    shown = {(log.file, line): summary(e) for log in part.logs for line, e in log.events}
    assert shown.items() < rows.items()
    for log, history, old in zip(part.logs, part.histories, whole.histories, strict=True):
        lines = {line for line, _ in log.events}
        wanted = {line: state for line, state in states(old).items() if line in lines}
        assert states(history) == wanted and history.why_not == old.why_not
        assert lines == set(range(min(lines), max(lines) + 1))
    assert [v.as_dict() for v in part.runs[0].verdicts] == [
        verdict_of(path).as_dict() for path in (FOUR[1], FOUR[0], *FOUR[2:])
    ]


def test_what_stands_outside_a_part_is_neither_lost_nor_forged() -> None:
    whole, part = (
        Counter(kind for _, kind, *_ in fives(as_dict(page)["arrows"]))
        for page in (four(), load(FOUR, part=PagePart(100, 200)))
    )
    assert whole[LOST] and part[DELIVERED] and not part[LOST] and not part[FORGED]


def test_a_part_says_which_it_is_and_where_it_goes_on() -> None:
    page = load(FOUR[:2], part=PagePart(100, 200))
    data = as_dict(page)
    assert f"{FOUR[0]} lines 100 to 200" in page.note and "by itself" in page.note
    assert page.note.replace("&", "&amp;") in html(page).decode()
    for made, log in zip(data["logs"], page.logs, strict=True):
        assert made["before"] == log.events[0][1].seq - 1 > 0 and made["end"] == "goes on"
        assert made["header"] == records(Path(log.file))[0]
    assert data["runs"][0]["system"] is None
    assert [made["before"] for made in as_dict(four())["logs"]] == [0] * len(FOUR)


def test_a_log_without_a_message_of_the_part_is_left_out_and_named(tmp_path: Path) -> None:
    stranger = restarts(tmp_path / "7.ndjson", 50)
    page = load([FOUR[0], stranger], part=PagePart(100, 200))
    assert len(page.logs) == 1 and f"No message of these lines is in {stranger}" in page.note


def test_a_divergence_before_a_part_is_the_reason_that_no_state_is_known() -> None:
    log = CORPUS / "bad" / "wrong_proposal.ndjson"
    (verdict,) = verdicts_of([log])
    page = load([log], part=PagePart(verdict.finding.at.line + 1, len(records(log))))
    assert page.histories[0].steps == [] and page.histories[0].why_not.endswith(
        str(verdict.finding.at.line)
    )
    assert as_dict(page)["logs"][0]["diverges"] == -1
    assert page.runs[0].verdicts[0].finding.at.line == verdict.finding.at.line
