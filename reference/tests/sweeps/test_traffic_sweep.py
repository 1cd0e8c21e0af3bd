"""The sweep over seeds of traffic, without SUMO: what it reports, and that it repeats."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from traffic_stage import traffic

from automcm_evaluation.traffic_experiment import traffic_sweep
from automcm_evaluation.traffic_experiment.traffic_sweep import COLLISIONS
from automcm_simulation.traffic.traffic import Traffic
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic_scenarios.traffic_run import TrafficRun, wrong

CORPUS = Path(__file__).parents[3] / "traces" / "corpus"
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


def check(twice: bool = False) -> dict[str, Any]:
    return traffic_sweep.run({"scenario": "lane-change", "seed": 5, "twice": twice})


def test_a_good_run_has_nothing_wrong_and_repeats() -> None:
    found = check(twice=True)
    assert found["wrong"] == [] and found["sha256"] == check()["sha256"]


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


def test_a_record_without_stations_has_no_hazards() -> None:
    collisions = dict.fromkeys(COLLISIONS, 0)
    assert wrong({"collisions": collisions, "hazards": None}) == []


def test_a_log_that_is_not_allowed_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    good = sorted((CORPUS / "pair").glob("*.ndjson"))
    assert len(good) > 1 and traffic_sweep.not_allowed(good) == []
    bad = traffic_sweep.not_allowed([CORPUS / "bad" / "busy_accepted.ndjson"])
    assert [re.sub(r"\d+", "7", line) for line in bad] == ["busy_accepted.ndjson:7: diverges"]
    judged: list[list[str]] = []

    def not_allowed(logs: Sequence[Path]) -> list[str]:
        judged.append([log.name for log in logs])
        return bad

    monkeypatch.setattr(traffic_sweep, "not_allowed", not_allowed)
    assert check()["wrong"] == bad
    assert judged == [["1.ndjson", "2.ndjson", "3.ndjson", "4.ndjson"]]


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
