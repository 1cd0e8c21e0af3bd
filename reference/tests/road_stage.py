"""Drivers on the simulated road, for the tests of the applications on the service."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from automcm.scenarios.drive import SimulatedDrive
from automcm.scenarios.lane_change import LaneChange
from automcm_spec.vocabulary import messages


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
