"""Two runs on one page: what is the same shares a row, and where they part is marked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from merged_runs import later, records, simulated
from page_rows import DELIVERED, DUPLICATE
from test_page import CORPUS, FOUR, column, data_of, events, fives

from automcm_traces.edit.log_diff import diff
from automcm_traces.viewer.page import html
from automcm_traces.viewer.page_data import BESIDE, IS_CAM, OF_CAM, Page, as_dict, of_runs
from automcm_traces.viewer.page_run import load

Json = Any
PAIR = sorted((CORPUS / "pair").glob("*.ndjson"))


class Two(NamedTuple):
    logs: tuple[list[Path], list[Path]]
    page: Page
    text: bytes
    data: Json


@pytest.fixture(scope="module", params=[(3, 5, 0.0), (100, 110, 0.1)], ids=str)
def two(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Two:
    """Two runs that part."""
    one, other, loss = request.param
    run: dict[str, Any] = {"loss": loss, "duplicate": 0.1, "until": 7_000}
    a = simulated(tmp_path_factory.mktemp("a"), 1001, 2002, 3003, seed=one, **run)
    b = simulated(tmp_path_factory.mktemp("b"), 1001, 2002, 3003, seed=other, **run)
    page = beside(a, b)
    text = html(page)
    return Two((a, b), page, text, data_of(text))


def beside(a: list[Path], b: list[Path], stations: dict[int, int] | None = None) -> Page:
    return of_runs(load(a), load(b), stations)


def pairs(data: Json) -> list[int]:
    """The rows that stand beside the one before."""
    return [row for row, flag in enumerate(column(data["rows"], "flags")) if flag & BESIDE]


def is_cam(data: Json, row: int) -> bool:
    return bool(column(data["rows"], "flags")[row] & (OF_CAM | IS_CAM))


def test_equal_runs_share_every_row_but_those_of_cams() -> None:
    data = data_of(html(beside(FOUR, FOUR)))
    assert data["compared"]["same"] and data["compared"]["first"] == -1
    shared = set(pairs(data))
    rows = range(len(data["rows"]["kinds"]))
    alone = [r for r in rows if r not in shared and r + 1 not in shared]
    assert len(shared) > 100 and all(is_cam(data, row) for row in alone)


@pytest.mark.sweep(1)
def test_each_run_is_there_as_it_stands_alone(two: Two) -> None:
    data = two.data
    found = events(data)
    logs = column(data["rows"], "log")
    for n, paths in enumerate(two.logs):
        told = json.loads(json.dumps(load(paths).judged()))
        assert data["runs"][n]["verdicts"] == told["logs"]
        assert data["runs"][n]["system"] == told["system"]
        for path, log in zip(paths, range(3 * n, 3 * n + 3), strict=True):
            mine = [e for i, (_, _, e) in zip(logs, found, strict=True) if i == log]
            assert mine == records(path)[1:-1]
            assert data["logs"][log]["run"] == n and data["logs"][log]["file"] == str(path)


@pytest.mark.sweep(1)
def test_what_shares_a_row_is_of_one_station_and_the_same_but_the_first_difference(
    two: Two,
) -> None:
    page, data = two.page, two.data
    found, logs = events(data), column(data["rows"], "log")
    assert page.comparison is not None
    last = {b for a, b in page.comparison.ends if a and b}
    equal = 0
    for row in pairs(data):
        assert row - 1 not in pairs(data)
        assert logs[row] == logs[row - 1] + 3 and found[row][0] == found[row - 1][0]
        if page.nodes[row] not in last:
            assert found[row][2]["ev"] == found[row - 1][2]["ev"]
            equal += 1
    assert equal > 5


def test_up_to_the_first_difference_all_that_diff_finds_equal_shares_a_row(two: Two) -> None:
    data, told = two.data, diff(*two.logs)
    compared = data["compared"]
    first = compared["stations"][compared["first"]]["row"]
    found, logs = events(data), column(data["rows"], "log")
    place = {(logs[row], found[row][1]): row for row in range(len(found))}
    marked, shared = [], 0
    for n, one in enumerate(told.stations):
        for a, b in one.pairs:
            if max(place[n, a], place[n + 3, b]) < first:  # not so: B does it after the difference
                assert place[n + 3, b] == place[n, a] + 1
                shared += 1
        d = one.difference
        assert d is not None
        ends = [place[n + 3 * s, deed.line] for s, deed in enumerate((d.a, d.b)) if deed]
        assert compared["stations"][n]["row"] == min(ends)
        marked += ends
    assert first == min(marked) and shared > 3


def test_messages_stay_in_their_run_and_go_down(two: Two) -> None:
    data = two.data
    found, logs = events(data), column(data["rows"], "log")
    arrived = [a for a in fives(data["arrows"]) if a[1] in (DELIVERED, DUPLICATE)]
    assert len({data["logs"][a[3]]["run"] for a in arrived}) == 2
    for row, _, down, source, to in arrived:
        assert logs[row] == source and data["logs"][source]["run"] == data["logs"][to]["run"]
        if not is_cam(data, row):
            assert down > 0 and found[row][2]["tx"] == found[row + down][2]["tx"]
            assert logs[row + down] == to


@pytest.mark.slow
def test_runs_that_begin_at_other_times_are_aligned_all_the_same(tmp_path: Path) -> None:
    late = [later(path, 70_000, tmp_path) for path in FOUR]
    data, same = as_dict(beside(FOUR, late)), as_dict(beside(FOUR, FOUR))
    assert [log["ahead"] for log in data["logs"]] == [
        *(log["ahead"] for log in same["logs"][:4]),
        *(log["ahead"] + 70_000 for log in same["logs"][4:]),
    ]
    assert pairs(data) == pairs(same) and data["rows"]["log"] == same["rows"]["log"]


def test_without_javascript_the_difference_is_told(two: Two) -> None:
    page = two.text.decode()
    table = page[page.index("<noscript>") : page.index("</noscript>")]
    assert "1001: DIFFERS after" in table and "<td>A · 1001" in table and "<td>B · 1001" in table
    assert f"A: {two.logs[0][0]}: ALLOWED" in table and f"B: {two.logs[1][0]}: ALLOWED" in table
