"""Whole sessions over a radio that loses, repeats and reorders; virtual time, seeded."""

from __future__ import annotations

import json
import logging
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from automcm.core.state import State
from automcm.core.station import Effects
from automcm.links.simulated_radio import Channel
from automcm.service.service import Observer
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_simulation.road.sweep_report import driven
from automcm_spec.log_format import writer
from automcm_spec.vocabulary.application import Indication
from automcm_spec.vocabulary.parameters import Parameters

PRESCRIBER, TARGET = 1001, 2002
STATIONS = (1001, 2002, 3003, 4004)
END = 12_000
SEEDS = range(10)
LOSSES = (0.0, 0.2, 0.4)


class Watched(Simulation):
    """A simulation that keeps what every station was told and every state it was in."""

    together = 0
    hazards = True
    """Whether S-3, S-4 and S-5 are looked at."""

    def __init__(self, **more: Any) -> None:
        super().__init__(**more)
        self.seen: dict[int, list[State]] = {}
        self.told: dict[int, list[Indication]] = {}

    def watching(self, station_id: int) -> tuple[Observer, ...]:
        states = self.seen.setdefault(station_id, [])
        told = self.told.setdefault(station_id, [])

        def observe(before: State, effects: Effects) -> None:
            if not states or effects.state is not states[-1]:
                states.append(effects.state)
            told.extend(effects.indications)
            self._look()

        return (observe,)

    def _look(self) -> None:
        """S-3, S-4, S-5: who acts as a prescriber has a target that acts on its word."""
        for service in self.services.values() if self.hazards else ():
            st = service.state
            if (st.role, st.phase) == ("prescriber", "ACTUATING"):
                peer = self.services[st.target].state
                assert (peer.role, peer.phase) == ("receiver", "ACTUATING"), self.clock.now()
                assert (peer.session, peer.proposal) == (st.session, st.proposal)
                self.together += 1


def world(
    seed: int = 0,
    loss: float = 0.0,
    logs: Path | None = None,
    hazards: bool = True,
    **parameters: int,
) -> Watched:
    """A prescriber and three receivers; the lane change is asked for at 500 ms."""
    simulation = Watched(seed=seed, channel=Channel(loss=loss, duplicate=0.2), logs=logs)
    simulation.hazards = hazards
    for station_id in STATIONS:
        driver = Straight(target=TARGET)
        simulation.add(station_id, driver, Parameters(**parameters))
    simulation.request(PRESCRIBER, 500)
    return simulation


def heard(simulation: Watched, station_id: int, name: str) -> list[Indication]:
    return [told for told in simulation.told[station_id] if told.name == name]


def reasons(simulation: Watched, station_id: int) -> list[str]:
    return [indication.reason for indication in heard(simulation, station_id, "fallback")]


@pytest.mark.sweep(1)
@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize(
    "seed", [pytest.param(s, marks=[pytest.mark.deep] * (s >= 3)) for s in SEEDS]
)
def test_same_seed_same_bytes(tmp_path: Path, seed: int, loss: float) -> None:
    logs = []
    for name in ("first", "second"):
        folder = tmp_path / name
        folder.mkdir()
        world(seed, loss, folder).run(7000)
        logs.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert logs[0] == logs[1]
    assert sorted(logs[0]) == [f"{station_id}.ndjson" for station_id in STATIONS]


def test_what_is_written_unvalidated_is_what_validation_would_write(tmp_path: Path) -> None:
    simulation = world(1, 0.3, tmp_path)
    service, at = simulation.services[TARGET], simulation.clock.at
    at(3000, lambda: service.receive(b"no message"))
    at(3001, lambda: service.rejected("stale", b"old"))
    at(3002, service.restart)
    simulation.run(4000)
    for path in tmp_path.iterdir():
        for line in path.read_bytes().splitlines(keepends=True):
            assert writer._line(json.loads(line)) == line


@pytest.mark.sweep(4)
@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize("seed", SEEDS)
def test_s_1_s_5_l_1_a_session_over_a_lossy_radio(seed: int, loss: float) -> None:
    simulation = world(seed, loss)
    simulation.run(END)
    for station_id, states in simulation.seen.items():
        for before, st in pairwise(states):
            # S-1: from one session to another only through STANDALONE
            assert st.session == before.session or None in (st.session, before.session)
        # L-1, L-4: every session ends, every message is acknowledged or given up
        st = simulation.services[station_id].state
        assert (st.phase, st.session, st.outbox) == ("STANDALONE", None, ())
    assert set(simulation.seen) == set(STATIONS)
    assert simulation.together > 0
    assert len(heard(simulation, PRESCRIBER, "accepted")) == 1
    assert len(heard(simulation, TARGET, "finished")) == 1


def acting(seed: int) -> Watched:
    """At 4000 ms both act.  (S-5 is not looked at: a restart is its excuse.)"""
    simulation = world(seed, hazards=False)
    simulation.run(4000)
    for station_id in (PRESCRIBER, TARGET):
        assert simulation.services[station_id].state.phase == "ACTUATING"
    return simulation


@pytest.mark.parametrize("seed", SEEDS[:3])
def test_act_2_a_target_that_restarts_leads_to_fallback(seed: int) -> None:
    simulation = acting(seed)
    simulation.restart(TARGET, 4010)
    simulation.run(4010 + 1500 - 100)
    assert simulation.services[PRESCRIBER].state.phase == "ACTUATING"
    simulation.run(4010 + 1500 + 40)
    assert reasons(simulation, PRESCRIBER) == ["cam_loss"]
    assert simulation.services[PRESCRIBER].state.phase == "STANDALONE"
    simulation.run(END)
    assert all(station.state.outbox == () for station in simulation.services.values())


def test_a_station_id_is_added_once() -> None:
    simulation = Simulation()
    simulation.add(1, Straight())
    with pytest.raises(ValueError, match="station_id 1 has a link"):
        simulation.add(1, Straight())


def test_a_sweep_of_drives_leaves_the_level_of_the_services_logger(
    caplog: pytest.LogCaptureFixture,
) -> None:
    with caplog.at_level(logging.WARNING, "automcm.service"):
        driven([1], "", 1, lambda text: None)
        assert logging.getLogger("automcm.service").level == logging.WARNING
