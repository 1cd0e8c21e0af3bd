"""How fast traffic with stations runs in SUMO, beside SUMO alone."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import pytest

from automcm_maintenance.benches.plugin import Figure
from automcm_simulation.traffic.mover import STEP_MS, TrafficError
from automcm_simulation.traffic.sumo_mover import SumoMover, sumo_home
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic_scenarios.catalogue import SCENARIOS
from automcm_simulation.traffic_scenarios.traffic_run import TrafficRun

RUN = TrafficRun(
    scenario="lane-change",
    setting=TrafficSetting(vehicles=100, density=40, duration_s=10, penetration=0.0),
    radio="table",
)


@pytest.fixture(autouse=True)
def installed() -> None:
    """Leave out what needs SUMO."""
    try:
        sumo_home()
    except TrafficError as error:
        pytest.skip(str(error))


def bench_sumo_alone(tmp_path: Path, figure: Figure) -> None:
    """The processor's ms for a simulated second, as below."""
    scenario, setting = SCENARIOS[RUN.scenario], RUN.setting
    mover = SumoMover(scenario.users(setting), scenario.network, tmp_path, setting.seed)
    begun = time.process_time()
    for _ in range(round(setting.duration_s * 1000 / STEP_MS) - 1):
        mover.step()
    figure(1000 * (time.process_time() - begun) / setting.duration_s, "ms")
    mover.close()


@pytest.mark.parametrize("share", [0.0, 0.1, 1.0])
def bench_traffic(share: float, figure: Figure) -> None:
    """With measures, and with so many stations, from the first step on."""
    begun: list[float] = []

    def progress(now_ms: int) -> None:
        begun.append(time.process_time())

    replace(RUN, setting=replace(RUN.setting, penetration=share)).drive(progress=progress)
    took = time.process_time() - begun[0]
    figure(1000 * took / RUN.setting.duration_s, "ms", beside=("sumo_alone", 200))
