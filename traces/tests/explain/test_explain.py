"""What a log means.  Logs are the reference's own, and forged ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from edits import Edited, edited, find
from merged_runs import simulated

from automcm.links.simulated_radio import Radio
from automcm_spec.log_format import reader
from automcm_spec.log_format.log import Event, Receive, Send, TimerArm, TimerEnd
from automcm_spec.log_format.reader import read
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.checker.engine import Engine
from automcm_traces.explain.explain import (
    exit_code,
    explain,
    judged_logs,
    verdict_of,
    verdicts_of,
    verdicts_together,
)
from automcm_traces.explain.lint import report
from automcm_traces.viewer.page_run import load

CORPUS = Path(__file__).parents[2] / "corpus"


def four_stations(folder: Path, seed: int = 3, parameters: Parameters | None = None) -> list[Path]:
    """One prescriber and three receivers, default parameters, real ids, 20 % loss."""
    run: dict[str, Any] = {"seed": seed, "loss": 0.2, "duplicate": 0.1, "until": 10_000}
    return simulated(folder, 1001, 2002, 3003, 4004, parameters=parameters, target=3003, **run)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return four_stations(tmp_path_factory.mktemp("logs"))


def later(first: int, ms: int, last: int | None = None) -> Callable[[Edited], None]:
    """All that happens from one line on, to another or the end, is so much later."""

    def edit(log: Edited) -> None:
        for record in log.records[first - 1 : last]:
            for name in {"t_ms", "deadline"} & record.keys():
                record[name] += ms

    return edit


def test_each_log_of_several_is_read_and_followed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    read_, fed = Counter[bytes](), Counter[tuple[int, int]]()

    def parse(line: bytes, **first: bool) -> Any:
        read_[line] += 1
        return real_parse(line, **first)

    def feed(self: Engine, at: int, event: Event) -> None:
        fed[self.track.me, at] += 1
        real_feed(self, at, event)

    real_parse, real_feed = reader.parse, Engine.feed
    monkeypatch.setattr(reader, "parse", parse)
    monkeypatch.setattr(Engine, "feed", feed)
    paths = sorted((CORPUS / "four-vehicles").glob("*.ndjson"))
    for way in (lambda: verdicts_together(judged_logs(paths)), lambda: load(paths)):
        way()
        assert len(read_) > 200 and set(read_.values()) == {1}
        assert len(fed) > 200 and set(fed.values()) == {1}
        read_.clear()
        fed.clear()


def test_a_log_that_is_left_out_is_named(logs: list[Path], tmp_path: Path) -> None:
    lines = logs[1].read_text().splitlines(keepends=True)
    gap = tmp_path / "gap.ndjson"
    gap.write_text("".join(lines[:20] + lines[21:]))
    _, report = verdicts_together(judged_logs([logs[0], gap]))
    assert f"{gap}: not judged together: a part of it is missing" in report.notices


def test_logs_of_one_run_keep_equal_messages_once(logs: list[Path], tmp_path: Path) -> None:
    def spoil(log: Edited) -> None:
        log.at(log.find("receive", type="CAM", src=1001))["message"].update(v=True)
        other = log.at(log.find("receive", src=1001, dst=2002))
        other["message"] = dict(reversed(other["message"].items()))

    odd = edited(logs[1], tmp_path, spoil)
    one, other = (dict(found.log or ()) for found in judged_logs([logs[0], odd]))
    sent = {e.tx: e.message for e in one.values() if isinstance(e, Send)}
    received = [e for e in other.values() if isinstance(e, Receive) and e.tx in sent]
    alike = [e.message is sent[e.tx or ""] for e in received]
    assert len(alike) > 50 and alike.count(False) == 2
    timers = [e.timer for e in one.values() if isinstance(e, TimerArm | TimerEnd)]
    assert len(timers) > len(set(timers)) == len({id(timer) for timer in timers})


def test_msg_1_stations_that_overhear_everything_are_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a shared radio each hears what is meant for the others, Acks too."""
    send = Radio._send
    monkeypatch.setattr(Radio, "_send", lambda self, src, data, _, tx: send(self, src, data, 0, tx))
    paths = four_stations(tmp_path)
    overheard = find(paths[1], "receive", type="Ack", dst=3003)
    assert overheard and exit_code(verdicts_of(paths)) == 0


@pytest.mark.parametrize(
    ("late_ms", "verdict"), [(50, "diverges"), (None, "diverges"), (70, "allowed")]
)
def test_how_late_a_timer_may_be_can_be_told(
    logs: list[Path], tmp_path: Path, late_ms: int | None, verdict: str
) -> None:
    """A log in which everything from the first expiry on is 60 ms later."""
    late = edited(logs[0], tmp_path, later(find(logs[0], "timer", op="expire"), 60))
    assert verdicts_of([late], late_ms)[0].verdict == verdict


def test_the_small_log_of_the_page_is_what_it_says(tmp_path: Path) -> None:
    page = (Path(__file__).parents[3] / "docs/trace-format.md").read_text()
    (log,) = page.split("## A log of your own")[1].split("## Judge")[0].split("```\n")[1::2]
    found = []
    wrong = log.replace('"proposal":1,"accepted"', '"proposal":2,"accepted"')
    for content in (log, wrong):
        path = tmp_path / "log.ndjson"
        path.write_text(content)
        assert report(path, 0).verdict == "clean"
        found.append(verdict_of(path))
    assert [v.verdict for v in found] == ["allowed", "diverges"]
    last = found[1].finding
    assert last.at.line == 7 and f"`{last.observed}`" in " ".join(page.split())


def test_what_is_called_for_by_a_malformed_message_is_said(
    logs: list[Path], tmp_path: Path
) -> None:
    number = find(logs[2], "receive", type="Prescription")
    wrong = edited(logs[2], tmp_path, lambda log: log.at(number)["message"].update(v=2))
    why = f"; the message of line {number} is malformed (v: must be at most 1)"
    found = explain(read(wrong)).finding
    assert (found.at.line, found.observed) == (number, f"phase NEGOTIATING{why}")
    wrong.write_text(wrong.read_text().replace(',"phase":"NEGOTIATING","role":"receiver"', ""))
    found = explain(read(wrong)).finding
    assert (found.at.line, found.rule) == (number + 1, "END-5")
    assert found.observed == f"send Ack to 1001: no input calls for it{why}"


def test_logs_of_other_runs_forge_nothing(logs: list[Path], tmp_path: Path) -> None:
    """The same transmission ids in another run are other transmissions."""
    other = tmp_path / "other.ndjson"
    other.write_text(four_stations(tmp_path, 4)[0].read_text())
    assert {v.verdict for v in verdicts_of([*logs[1:], other])} == {"allowed"}


def test_a_late_timer_is_told_with_what_the_station_says_of_it(
    logs: list[Path], tmp_path: Path
) -> None:
    """The verdict stays: late_ms is a hint.  A tolerance as large as it says allows the log."""
    n = find(logs[1], "timer", op="expire")
    late = edited(logs[1], tmp_path, later(n, 900))
    path = edited(late, tmp_path, lambda log: log.at(n).update(late_ms=900))
    verdict = verdict_of(path)
    assert verdict.verdict == "diverges"
    hint = f"the station reports that it was 900 ms late (late_ms, line {n})"
    assert hint in verdict.finding.observed
    assert "late_ms" not in verdict_of(path, 1000).finding.observed
