"""The paper's measurement under loss: a drive to the target with or without agreement (VI-C)."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from automcm.applications.lane_change import PaperLaneChange, Plan
from automcm.applications.vehicle import LateBraking, Vehicle
from automcm_evaluation.framework.experiment import ExperimentError, Values, columns
from automcm_simulation.road.drive import SimulatedDrive, arrival_s
from automcm_simulation.road.simulation import Simulation
from automcm_spec.vocabulary.parameters import Parameters

SPEED_KMH = 30.0
"""The paper's."""
TOO_LATE_S = 300.0


class Insists(PaperLaneChange):
    """A prescriber that changes lanes even without an agreement, as the paper's does without
    coordination (section VI-B)."""

    def _alone(self) -> None:
        lane, driving = self.wanted, self.service.now() / 1000
        super()._alone()
        if lane is not None and self.vehicle.lane != lane:
            self.wanted = lane
            self.vehicle.change_lane(lane, driving)


def drive(values: Values, simulation: Simulation, beside_m: float, signal_m: float) -> Values:
    """One drive: ``arrival_s`` of the receiver since the signal, whether they ``agreed``, whether
    the prescriber ``completed`` (changed lanes as agreed and sent its Fin), and whether the
    receiver ``stopped``.

    ``simulation`` determines the loss.  Raises ExperimentError if the receiver does not arrive.
    """
    speed, t_timeout = SPEED_KMH / 3.6, values["t_timeout"]
    prescriber = Insists(Vehicle(1, beside_m, 0, speed, speed), Plan(hold_s=t_timeout / 1000))
    receiver = PaperLaneChange(Vehicle(2, 0.0, 1, speed, speed, late=LateBraking()))
    parameters = Parameters(t_timeout=t_timeout)
    driven = SimulatedDrive([prescriber, receiver], parameters=parameters, simulation=simulation)
    signal_ms = round(signal_m / speed * 1000)
    driven.simulation.clock.at(signal_ms, lambda: prescriber.signal(1))
    until_s, arrival = 30.0, None
    while arrival is None:
        until_s += 5
        if until_s > TOO_LATE_S:
            raise ExperimentError(f"the receiver does not arrive: {values}")
        driven.run(until_s)
        arrival = arrival_s(driven.road.of(2), values["target_m"])
    return {
        "arrival_s": round(arrival - signal_ms / 1000, 3),
        "agreed": int(any("is accepted" in what for _, what in prescriber.story)),
        "completed": int(any(kind == "Fin" for _, _, kind in driven.sent)),
        "stopped": int(any(sample.speed == 0 for sample in driven.road.of(2))),
    }


def block(values: Values, seed: int, over: Callable[..., Simulation]) -> Values:
    """Drives in one cell: a list for each figure.  ``over`` makes the simulation for a seed."""
    random = Random(seed)
    drives = []
    for _ in range(values["trials"]):
        own = random.getrandbits(31)
        beside_m, signal_m = (random.uniform(*values[name]) for name in ("beside_m", "signal_m"))
        drives.append(drive(values, over(seed=own), beside_m, signal_m))
    return columns(drives)
