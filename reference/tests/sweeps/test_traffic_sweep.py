"""The sweep over seeds of traffic, without SUMO: what it reports, and that it repeats."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from traffic_stage import traffic

from automcm_evaluation.framework.experiment import Cell
from automcm_evaluation.sweeps import traffic_sweep
from automcm_evaluation.sweeps.traffic_sweep import COLLISIONS
from automcm_simulation.traffic.mover import TrafficError
from automcm_simulation.traffic.traffic import Traffic
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic_scenarios.traffic_run import TrafficRun, wrong

Change = Callable[[dict[str, Any]], None]


class Staged(TrafficRun):
    """Moved by the small road; the record is changed by ``change``."""

    change: Change = staticmethod(lambda record: None)
    seeds: list[int] | None = None
    """The seeds of its runs in turn, in place of the setting's."""

    def drive(self, *, logs: Path | None = None, **more: Any) -> Traffic:
        seed = self.seeds.pop() if self.seeds else self.setting.seed
        made, _ = traffic(seed=seed, vehicles=4, loss=0.3, duration_s=4, logs=logs)
        made.run()
        return made

    def record(self, traffic: Traffic) -> dict[str, Any]:
        record = super().record(traffic)
        Staged.change(record)
        return record


@pytest.fixture(autouse=True)
def staged(monkeypatch: pytest.MonkeyPatch) -> None:
    def drawn(scenario: str, seed: int) -> TrafficRun:
        return Staged(scenario=scenario, setting=TrafficSetting(seed=seed))

    monkeypatch.setattr(traffic_sweep, "drawn", drawn)


def check(twice: bool = False, judge: traffic_sweep.Judge = lambda logs: []) -> dict[str, Any]:
    return traffic_sweep.check({"scenario": "lane-change", "seed": 5, "twice": twice}, judge)


def test_a_good_run_has_nothing_wrong_and_repeats() -> None:
    judged: list[list[str]] = []

    def judge(logs: Sequence[Path]) -> list[str]:
        judged.append([log.name for log in logs])
        return []

    found = check(twice=True, judge=judge)
    assert found["wrong"] == [] and found["sha256"] == check()["sha256"]
    assert judged == [["1.ndjson", "2.ndjson", "3.ndjson", "4.ndjson"]]


@pytest.mark.sweep(2)
@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda r: r["collisions"].update(between_equipped=2), "2 collisions between equipped"),
        (lambda r: r["collisions"].update(by_maneuver=1), "1 collisions by a maneuver"),
        (
            lambda r: r["collisions"].update(with_pedestrian=1),
            "1 collisions of an equipped vehicle with a pedestrian",
        ),
        (
            lambda r: r["hazards"]["wrong"].append({"seed": 5, "ms": 9, "excuse": ""}),
            "a hazard of 9 ms with no excuse",
        ),
    ],
)
def test_collisions_and_hazards_are_wrong(
    change: Change, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Staged, "change", staticmethod(change))
    (line,) = check()["wrong"]
    assert line.startswith(text)


def test_collisions_of_others_are_not_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    change = staticmethod(lambda record: record["collisions"].update(all=1))
    monkeypatch.setattr(Staged, "change", change)
    assert check()["wrong"] == []


def test_a_record_without_stations_has_no_hazards() -> None:
    collisions = dict.fromkeys(COLLISIONS, 0)
    assert wrong({"collisions": collisions, "hazards": None}) == []


def test_a_log_that_is_not_allowed_is_wrong() -> None:
    assert check(judge=lambda logs: ["2.ndjson:7: diverges"])["wrong"] == ["2.ndjson:7: diverges"]


def test_other_bytes_of_the_same_seed_are_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Staged, "seeds", [5, 6])
    assert check(twice=True)["wrong"] == ["a second run of the same seed wrote other bytes"]


def test_a_run_that_breaks_off_is_wrong_and_ends_no_sweep(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(record: dict[str, Any]) -> None:
        raise RuntimeError("a lane is not known")

    good = check()
    monkeypatch.setattr(Staged, "change", staticmethod(lost))
    found = check()
    assert found["wrong"] == ["it broke off: RuntimeError('a lane is not known')"]
    assert found.keys() == good.keys() and found["command"] == good["command"]


@pytest.mark.parametrize("error", [TrafficError("SUMO is missing"), OSError("full"), MemoryError()])
def test_what_is_missing_on_this_machine_is_not_a_bad_run(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(record: dict[str, Any]) -> None:
        raise error

    monkeypatch.setattr(Staged, "change", staticmethod(missing))
    with pytest.raises(type(error)):
        check()


def test_all_scenarios_run_with_the_first_seeds_and_every_nth_seed_twice() -> None:
    wanted = traffic_sweep.wanted(["a", "b"], 9, 2, 10)
    assert [(v["scenario"], v["seed"], v["twice"]) for v in wanted] == [
        *(("a", 9, False), ("b", 9, False), ("a", 10, True), ("b", 10, True)),
    ]
    assert not any(v["twice"] for v in traffic_sweep.wanted(["a"], 0, 2, 0))


def test_the_summary_adds_up_by_scenario() -> None:
    result = check() | {"hazards": 2, "longest_ms": 7, "wrong": ["x", "y"]}
    result["collisions"] = dict(zip(COLLISIONS, (1, 2, 3, 4), strict=True))
    values = traffic_sweep.wanted(["merge"], 0, 2, 2)
    found = traffic_sweep.summary(
        [Cell(values[0], result), Cell(values[1], result | {"longest_ms": 5, "wrong": []})]
    )
    assert found["merge"] == {
        **{"runs": 2, "twice": 1, "hazards": 4, "longest_ms": 7, "wrong": 1},
        **dict(zip(COLLISIONS, (2, 4, 6, 8), strict=True)),
        **{name: 2 * result[name] for name in ("requested", "agreed", "completed")},
    }
