"""TLC as the independent judge: each kind of log, right and wrong, and agreement with the oracle.

All logs of a kind are judged in one run of TLC, as it is meant to be used.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import agreement
import merged_runs
import pytest
from agreement import different, judgeable, written
from generated_logs import mutated
from merged_runs import records, rewritten
from tlc_engine import explain_batch, explain_each
from wrong_logs import PRESCRIBER, RECEIVER, WRONG, Records, change, find

from automcm.links.simulated_radio import Channel
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.application import Abort
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.explain.explain import Verdict, explain

Json = Any


def simulate(folder: Path) -> dict[str, Records]:
    """Logs by name: a session of two rounds, one aborted with a restart in it, three in a row, and
    one whose prescriber 1 hears no Ack, and the Acceptance late."""
    runs = {"rounds": 4, "abort": 5, "twice": 6}
    for run, seed in runs.items():
        (folder / run).mkdir()
        simulation = Simulation(seed=seed, channel=Channel(loss=0.2), logs=folder / run)
        usual, short = Parameters(t_cam=250), Parameters(t_cam=250, t_timeout=300)
        for station in (1001, 2002, 3003):
            driver = Straight(target=2002, refuse_first=run == "rounds", maneuver_ms=1000)
            simulation.add(station, driver, short if run == "twice" else usual)
        simulation.request(1001, at=500)
        if run == "abort":
            simulation.restart(3003, at=1000)
            simulation.command(1001, Abort(session=(1001, 1)), at=3500)
        if run == "twice":
            simulation.request(1001, at=5000)
            simulation.request(3003, at=6700)
        simulation.run(until=12_000 if run == "twice" else 9000)

    def deaf(_: int, dst: int, m: Any, now: int) -> bool:
        return dst == 1 and (m.type == "Ack" or (m.type == "Acceptance" and now < 2900))

    merged_runs.Run(folder / "deaf", drop=deaf).logs(until=12_000)
    return {
        f"{run}/{path.stem}": records(path)
        for run in (*runs, "deaf")
        for path in (folder / run).glob("*.ndjson")
    }


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Records]:
    return simulate(tmp_path_factory.mktemp("good"))


@pytest.fixture(scope="module")
def judged(
    good: dict[str, Records], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, tuple[int, Verdict, Verdict]]:
    """By name: the line, what the other engine says, and what TLC says."""
    folder = tmp_path_factory.mktemp("wrong")
    logs, lines = [], []
    for name, (base, spoil, _) in WRONG.items():
        records = copy.deepcopy(good[base])
        lines.append(spoil(records))
        logs.append(rewritten(folder / f"{name}.ndjson", records))
    other = map(explain, logs)
    return dict(zip(WRONG, zip(lines, other, explain_batch(logs), strict=True), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_log_diverges_at_its_line_by_the_rule_that_both_engines_name(
    name: str, judged: dict[str, tuple[int, Verdict, Verdict]]
) -> None:
    line, other, verdict = judged[name]
    assert (verdict.verdict, verdict.finding.at.line) == ("diverges", line), verdict
    assert (verdict.finding.at.line, verdict.finding.rule) == (
        other.finding.at.line,
        other.finding.rule,
    ), other
    assert WRONG[name][2] in ("", verdict.finding.rule)


# -- logs that are right, though they look odd


def large(r: Records) -> Records:
    """Numbers that TLC's 31 bits do not hold."""
    text = json.dumps(r).replace("[1001, 1]", "[1001, 900719925474099]")
    records: Records = json.loads(text)
    for record in records:
        for name in ("t_ms", "deadline"):
            if name in record:
                record[name] += 10**15
    return records


def without(*kinds: str) -> Callable[[Records], Records]:
    def strip(r: Records) -> Records:
        r[0]["complete"] = [kind for kind in r[0]["complete"] if kind not in kinds]
        return [x for x in r if x.get("ev") not in kinds]

    return strip


def cut(r: Records) -> Records:
    return r[: find(r, "receive", type="Prescription") + 1]


def no_stops(r: Records) -> Records:
    """END-8: all timers stop at a restart; a station that crashed cannot log it."""
    n = find(r, "restart")
    return [x for k, x in enumerate(r) if not (n < k < n + 20 and x.get("op") == "stop")]


RIGHT: dict[str, tuple[str, Callable[[Records], Records]]] = {
    "large numbers": (PRESCRIBER, large),
    "no end": (RECEIVER, cut),
    "a restart that stops no timer": ("abort/3003", no_stops),
    "no indications": (RECEIVER, without("indication")),
    "no commands": (PRESCRIBER, without("command")),
    "no timers": (RECEIVER, without("timer")),
    "no restarts": ("abort/3003", without("restart")),
    "no commands and timers": (RECEIVER, without("command", "indication", "timer")),
}


@pytest.mark.slow
def test_what_is_right_is_allowed(good: dict[str, Records], tmp_path: Path) -> None:
    logs = [
        rewritten(tmp_path / name.replace("/", "-"), copy.deepcopy(r)) for name, r in good.items()
    ]
    for name, (base, edit) in RIGHT.items():
        logs.append(rewritten(tmp_path / name, edit(copy.deepcopy(good[base]))))
    verdicts = explain_batch(logs)
    assert [v for v in verdicts if v.verdict != "allowed"] == []
    assert [v.events for v in verdicts] == [len(log.events) for log in logs]


@pytest.mark.slow
def test_without_timers_and_commands_a_wrong_log_still_diverges(
    good: dict[str, Records], tmp_path: Path
) -> None:
    records = copy.deepcopy(good[RECEIVER])
    change(records, find(records, "send", type="Acceptance"), "message", proposal=2)
    stripped = without("command", "timer")(records)
    line = find(stripped, "send", type="Acceptance") + 1
    (verdict,) = explain_batch([rewritten(tmp_path / "log", stripped)])
    assert (verdict.verdict, verdict.finding.at.line) == ("diverges", line)


# -- agreement

CORPUS = Path(__file__).parents[2] / "corpus"


@pytest.mark.slow
@pytest.mark.parametrize(("first", "every"), [(7, 10), pytest.param(0, 1, marks=pytest.mark.deep)])
def test_tlc_gives_each_log_of_the_corpus_its_verdict_line_and_rule(first: int, every: int) -> None:
    """Forged messages show only beside the log of their sender, without any engine."""
    index = json.loads((CORPUS / "index.json").read_text())
    index = [entry for entry in index if "beside" not in entry]
    index = [e for n, e in enumerate(index) if n % every == first or e["file"].startswith("bad/")]
    verdicts = explain_each([CORPUS / entry["file"] for entry in index])
    found = [
        (entry["file"], v.verdict, v.finding.at.line, v.finding.rule)
        for entry, v in zip(index, verdicts, strict=True)
    ]
    assert found == [(e["file"], e["verdict"], e["line"], e.get("rule", "")) for e in index]
    assert len(found) > 760 // every
    assert len({verdict for _, verdict, *_ in found}) == 4


@pytest.mark.parametrize("edits", [1, pytest.param(10, marks=pytest.mark.deep)])
def test_both_engines_agree_on_verdict_line_and_rule(
    edits: int, good: dict[str, Records], tmp_path: Path
) -> None:
    logs = []
    for n, base in enumerate(list(good.values()) * edits):
        lines, *_ = mutated([json.dumps(record) for record in base], n)
        logs += judgeable(written(lines, tmp_path / f"{n}"))
    assert len(logs) > 10 * edits and different(logs) == []
    assert {explain(log).verdict for log in logs} == {"allowed", "diverges"}


@pytest.mark.slow
def test_good_logs_are_allowed_and_both_engines_agree_on_edited_ones() -> None:
    assert agreement.main(60) == 0
