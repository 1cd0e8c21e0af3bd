"""Drivers on the simulated road, for the tests of the applications on the service."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from automcm.applications.lane_change import LaneChange
from automcm.applications.ramp_merge import STOP_M, Merge
from automcm.applications.vehicle import Vehicle
from automcm.service.application import Choice
from automcm_simulation.road.drive import SimulatedDrive
from automcm_spec.vocabulary import messages


class Records(LaneChange):
    """Keeps the choices that it is asked to make."""

    def choose(self, choice: Choice) -> None:
        self.asked = choice
        super().choose(choice)


def car(station_id: int, x: float, lane: int = 1) -> Vehicle:
    return Vehicle(station_id, x, lane, 8.33, 8.33)


def lane_changers(drive: SimulatedDrive) -> list[LaneChange]:
    return [driver for driver in drive.drivers if isinstance(driver, LaneChange)]


def said(driver: LaneChange) -> list[str]:
    return [what for _, what in driver.story]


def driven(
    signal: Callable[[], None], *drivers: Any, until: float = 30, **more: Any
) -> SimulatedDrive:
    """These drivers together, the first of which signals at 100 ms."""
    drive = SimulatedDrive(drivers, **more)
    drive.simulation.clock.at(100, signal)
    drive.run(until)
    return drive


def rows(*points: tuple[int, int, int], t0: int = 0) -> messages.Trajectory:
    return messages.Trajectory(t0=t0, points=points)


def answers_of(driver: Any) -> list[str]:
    """The names of the commands that a driver gives from now on; they go nowhere."""
    SimulatedDrive([driver])
    answers: list[str] = []
    driver.service.command = lambda command, after_ms=0: answers.append(command.name)
    return answers


def stands(drive: SimulatedDrive, driver: Merge) -> None:
    """On the ramp, just before its end, after it has braked gently."""
    v, ramp = driver.vehicle, driver.ramp
    left = ramp.joins_m + ramp.length_m - v.x - v.length / 2
    assert v.lane == 0 and not v.changing and v.speed < 0.05 and STOP_M / 2 < left < STOP_M * 2
    assert min(sample.acceleration for sample in drive.road.of(v.station_id)) > -2.01
