"""Several logs as one partial order, and how far their clocks can be compared."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from merged_runs import Run, later, matches_of, plain, records, rewritten, without_tx

from automcm.links.simulated_radio import Channel
from automcm_spec.log_format.log import Receive, Send
from automcm_spec.log_format.reader import Log, read
from automcm_traces.system.log_merge import MergeError, merge


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Log]:
    channel = Channel(loss=0.2, duplicate=0.2, reorder=0.2)
    return Run(tmp_path_factory.mktemp("logs"), channel=channel, seed=7).logs()


def copied(log: Log, folder: Path, change: Any = lambda record: None) -> Log:
    lines = records(Path(log.file))
    for record in lines:
        change(record)
    return rewritten(folder / Path(log.file).name, lines)


def test_every_event_comes_once_each_after_what_it_depends_on(logs: list[Log]) -> None:
    merged = merge(logs)
    assert sorted(merged.order) == [
        (i, k) for i, log in enumerate(logs) for k in range(len(log.events))
    ]
    place = {node: n for n, node in enumerate(merged.order)}
    for i, log in enumerate(logs):
        assert [k for j, k in merged.order if j == i] == list(range(len(log.events)))
    matches = matches_of(merged)
    assert len(matches) > 200 and not merged.cycles
    for node, (at, _) in matches.items():
        sent, got = merged.event(at), merged.event(node)
        assert isinstance(sent, Send) and isinstance(got, Receive) and sent.tx == got.tx
        assert place[at] < place[node] and merged.before(at, node)
        assert not merged.before(node, at)


def test_the_order_does_not_depend_on_that_of_the_files(logs: list[Log]) -> None:
    assert merge(logs[::-1]).order == merge(logs).order


def test_before_is_what_chains_of_messages_say(logs: list[Log]) -> None:
    """Held against a search backwards through the messages, for a sample of pairs."""
    merged = merge(logs)
    matches = matches_of(merged)

    def reached(b: tuple[int, int]) -> set[tuple[int, int]]:
        known, todo = set(), [b]
        while todo:
            i, k = todo.pop()
            if (i, k) in known or k < 0:
                continue
            known.add((i, k))
            todo.append((i, k - 1))
            if (i, k) in matches:
                todo.append(matches[i, k][1])
        return known

    nodes = merged.order[::47]
    answers = [merged.before(a, b) for b in nodes for a in nodes if a != b]
    known = {b: reached(b) for b in nodes}
    assert answers == [a in known[b] for b in nodes for a in nodes if a != b]
    assert 0.3 < sum(answers) / len(answers) < 0.6


def test_a_message_received_before_it_is_sent_is_named(tmp_path: Path) -> None:
    """The Intention of station 2, moved behind what the prescriber answers to it."""
    logs = plain(tmp_path)
    lines = records(Path(logs[1].file))
    sent = next(n for n, r in enumerate(lines) if r.get("message", {}).get("type") == "Intention")
    acked = next(
        n
        for n, r in enumerate(lines)
        if r.get("ev") == "receive" and r["message"].get("of", {}).get("type") == "Intention"
    )
    lines[sent]["t_ms"] = lines[acked]["t_ms"]
    lines.insert(acked, lines.pop(sent))
    for record in lines[sent:acked]:
        record["t_ms"] = min(record["t_ms"], lines[acked]["t_ms"])
    edited = rewritten(tmp_path / "2.ndjson", lines)
    merged = merge([logs[0], edited, logs[2]])
    assert len(merged.cycles) == 1 and len(merged.order) == sum(len(x.events) for x in merged.logs)
    text = merged.cycles[0]
    assert text.startswith("received before it was sent: ")
    assert f"2.ndjson:{acked}" in text and f"2.ndjson:{acked + 1}" in text and "1.ndjson:" in text


def test_two_logs_of_one_station_are_refused(logs: list[Log], tmp_path: Path) -> None:
    with pytest.raises(MergeError, match=r"station 2, as is .*2\.ndjson"):
        merge([logs[0], logs[1], copied(logs[1], tmp_path)])
    with pytest.raises(MergeError, match="no log"):
        merge([])


def test_a_transmission_id_that_comes_twice_is_noted(logs: list[Log], tmp_path: Path) -> None:
    def again(record: dict[str, Any]) -> None:
        if record.get("ev") == "send" and record["tx"] == "2:5":
            record["tx"] = "2:04"

    notices = merge([logs[0], copied(logs[1], tmp_path, again)]).notices
    assert len(notices) == 1 and "tx 2:04 repeats" in notices[0]


def test_without_transmission_ids_content_and_time_decide(tmp_path: Path) -> None:
    """With loss and copies, the match is the latest copy that can have been sent by then."""
    run = Run(tmp_path, channel=Channel(loss=0.3, duplicate=0.2))
    named = merge(run.logs())
    merged = merge([without_tx(tmp_path / f"{n}.ndjson") for n in (1, 2, 3)])
    sure, matches = matches_of(named), matches_of(merged)
    assert matches.keys() == sure.keys() and not merged.cycles
    assert len(merged.notices) == 1 and str(len(matches)) in merged.notices[0]
    later = [node for node, (sent, first) in matches.items() if first != sent]
    assert len(later) > 10
    place = {node: n for n, node in enumerate(merged.order)}
    for node, (sent, first) in matches.items():
        assert first <= sent and place[sent] < place[node]
        took = merged.event(node).t_ms - merged.event(sent).t_ms
        assert took <= 50, "no copy takes longer"
        assert sent >= sure[node][0]


def test_the_clocks_of_one_simulation_are_shown_to_be_nearly_the_same(logs: list[Log]) -> None:
    clocks = merge(logs).clocks
    for i in range(3):
        for j in range(3):
            ahead = clocks.ahead(i, j)
            assert ahead is not None and ahead.low <= 0 <= ahead.high and ahead.best == 0
            assert ahead.high - ahead.low <= 12 and not ahead.assumed


@pytest.mark.parametrize("ms", [3, 977, 3_600_000])
def test_the_difference_of_two_clocks_is_enclosed(logs: list[Log], tmp_path: Path, ms: int) -> None:
    two = read(later(Path(logs[1].file), ms, tmp_path))
    clocks = merge([logs[0], two, logs[2]]).clocks
    found, back = clocks.ahead(0, 1), clocks.ahead(1, 0)
    assert found is not None and back is not None
    assert found.low <= ms <= found.high and found.high - found.low <= 12
    assert (back.low, back.high) == (-found.high, -found.low)
    gap = clocks.between(0, 1000, 1, 1000 + ms + 70)
    assert gap is not None and gap.low <= 70 <= gap.high


def test_one_way_only_the_longest_delay_is_assumed(tmp_path: Path) -> None:
    """Stations 2 and 3 hear each other through nobody; 2 never hears 1."""
    run = Run(tmp_path, drop=lambda src, dst, m, now: dst == 2 or 3 in (src, dst))
    clocks = merge(run.logs(until=3000)[:2]).clocks
    ahead = clocks.ahead(0, 1)
    assert ahead is not None and ahead.assumed and ahead.low <= 0 <= ahead.high
    assert ahead.high - ahead.low <= 50


def test_without_messages_clocks_are_not_compared(tmp_path: Path) -> None:
    run = Run(tmp_path, drop=lambda src, dst, m, now: True)
    clocks = merge(run.logs(until=1000)).clocks
    assert clocks.ahead(0, 1) is None and clocks.between(0, 1, 1, 2) is None


def test_clocks_that_do_not_run_alike_are_noticed(logs: list[Log], tmp_path: Path) -> None:
    def slow(record: dict[str, Any]) -> None:
        if "t_ms" in record:
            record["t_ms"] = record["t_ms"] * 9 // 10

    clocks = merge([logs[0], copied(logs[1], tmp_path, slow)]).clocks
    assert clocks.ahead(0, 1) is None and "run at different rates" in clocks.notices[0]


def test_a_copy_under_way_for_too_long_is_measured(tmp_path: Path) -> None:
    run = Run(tmp_path, channel=Channel(delay_ms=(0, 90), reorder=0.0))
    clocks = merge(run.logs()).clocks
    assert 80 <= clocks.slowest(0, 1) <= 90
