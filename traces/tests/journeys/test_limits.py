"""MEM-1: the limits in a log's header decide who is recorded, joined and remembered."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from automcm.links.simulated_radio import Channel
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.application import Abort
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.explain.explain import Verdict, verdict_of

FULL = ({"max_participants": 2}, {"outbox_limit": 6, "max_participants": 4}, {"memory_limit": 1})


def logs(folder: Path, limits: dict[str, int]) -> list[Path]:
    """Three stations ask one after the other, five are concerned; one aborts and asks again."""
    simulation = Simulation(seed=4, channel=Channel(loss=0.4), logs=folder)
    for station in range(11, 16):
        driver = Straight(concerned_by_all=True, maneuver_ms=500, refuse_first=2)
        simulation.add(station, driver, Parameters(t_cam=900, t_timeout=1000, **limits))
    for n, station in enumerate((11, 12, 13, 12)):
        simulation.request(station, at=500 + 3500 * n)
    simulation.command(11, Abort(session=(11, 1)), at=1_450)
    simulation.request(11, at=1_460)
    simulation.run(until=16_000)
    return sorted(folder.iterdir())


def told(path: Path, **limits: int) -> Verdict:
    """The verdict on a log whose header tells other limits."""
    head, rest = path.read_text().split("\n", 1)
    header = json.loads(head)
    header["parameters"] |= limits
    path.write_text(json.dumps(header) + "\n" + rest)
    return verdict_of(path)


@pytest.mark.parametrize("limits", FULL, ids=lambda limits: next(iter(limits)))
def test_mem_1_who_is_full_may_refuse_and_who_has_room_must_use_it(
    limits: dict[str, int], tmp_path: Path
) -> None:
    paths = logs(tmp_path, limits)
    full = [path for path in paths if '"rule":"MEM-1"' in path.read_text()]
    assert full and {verdict_of(path).verdict for path in paths} == {"allowed"}
    defaults = {"max_participants": 32, "outbox_limit": 64, "memory_limit": 64}
    assert {told(path, **defaults).verdict for path in full} == {"diverges"}


def test_mem_1_a_station_that_is_full_must_not_record(tmp_path: Path) -> None:
    paths = logs(tmp_path, {})
    verdicts = [told(path, max_participants=1) for path in paths]
    assert "diverges" in {verdict.verdict for verdict in verdicts}
    assert {v.finding.rule for v in verdicts if v.verdict == "diverges"} == {"MEM-1"}
