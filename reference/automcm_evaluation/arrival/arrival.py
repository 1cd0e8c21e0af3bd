"""Arrival times of a receiver with and without coordination (section VI-B, Fig. 8).

A prescriber changes into the lane of a receiver.  The time is measured from the prescriber's signal
to the receiver's arrival at the target.  Each trial has two drives with the same start, seed and
drivers: with coordination and without.  The receiver's driver is ``road.Late``, which stops for a
vehicle that changes lanes just ahead.  The paper does not give its parameters, so the gain is also
measured over a grid of them, and in SUMO.
"""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from statistics import fmean as mean
from typing import Annotated

from pydantic import Field

from automcm.applications.lane_change import PaperLaneChange
from automcm.applications.vehicle import Driving, LateBraking
from automcm_evaluation.arrival import sumo
from automcm_evaluation.arrival.arrival_tables import SPEEDS_KMH
from automcm_evaluation.framework.experiment import (
    ExperimentError,
    ExperimentSettings,
    Values,
    blocks,
    columns,
    grid,
)
from automcm_simulation.road.drive import FourVehicles, arrival_s
from automcm_simulation.road.simulation import Simulation

TITLE = "Arrival with coordination and without (VI-B, Fig. 8)"
BLOCK = 10
"""Number of trials in one cell."""
TOO_LATE = 10
"""Time limit for an arrival, as a multiple of the undisturbed travel time."""
PLACES = ("target_m", "signal_m", "signal_span_m", "beside_m", "beside_span_m")
MODEL = {
    "notice": "notices",
    "brake": "brakes",
    "restart_s": "restarts_s",
    "restart_gap": "restart_gaps",
    "acceleration": "accelerations",
}
"""The parameters of the baseline, and the setting with the values tried of each."""
Notice = Annotated[float, Field(ge=0, le=3)]
Brake = Annotated[float, Field(gt=0, le=9)]
Wait = Annotated[float, Field(ge=0, le=10)]
Gap = Annotated[float, Field(ge=0, le=100)]
Acceleration = Annotated[float, Field(ge=0.5, le=4)]
Draw = tuple[float, float]
"""A trial's start: how far ahead the prescriber starts, and the distance before its signal, m."""


class Settings(ExperimentSettings):
    """Settings in SI units; distances are from the receiver's start, or centre to centre."""

    trials: int = Field(default=100, ge=2, le=1000)
    """Trials at each speed (the paper: 100)."""
    target_m: float = Field(default=260.0, ge=200, le=2000)
    """The paper's."""
    signal_m: float = Field(default=45.0, ge=0, le=100)
    """Minimum distance before the prescriber's signal; calibrated."""
    signal_span_m: float = Field(default=10.0, ge=0, le=50)
    """Maximum additional distance before the signal; assumed."""
    beside_m: float = Field(default=5.0, ge=0, le=20)
    """Minimum initial distance of the prescriber ahead of the receiver; assumed."""
    beside_span_m: float = Field(default=2.5, ge=0, le=20)
    """Maximum additional initial distance; assumed."""
    notice: Notice = LateBraking().notice
    brake: Brake = LateBraking().brake
    restart_s: Wait = LateBraking().restart_s
    restart_gap: Gap = LateBraking().restart_gap
    """Calibrated; the other four are assumed."""
    acceleration: Acceleration = Driving().acceleration
    """The driver parameters of all vehicles, with and without coordination."""
    draws: int = Field(default=3, ge=1, le=50)
    """Number of evenly spread starts for each baseline."""
    notices: tuple[Notice, ...] = (0.2, 0.5, 1.0, 1.75)
    brakes: tuple[Brake, ...] = Field(default=(2.0, 3.0, 4.0, 6.0, 8.0), min_length=1)
    restarts_s: tuple[Wait, ...] = Field(default=(0.0, 0.5, 1.5, 3.0, 5.0), min_length=1)
    restart_gaps: tuple[Gap, ...] = Field(
        default=(10.0, 20.0, 30.0, 40.0, 42.5, 45.0, 47.5, 50.0, 60.0, 80.0), min_length=1
    )
    """Closer together where they fit the paper, so that the range of those that fit is found."""
    accelerations: tuple[Acceleration, ...] = (1.0, 1.5, 2.0, 2.5)
    sumo: bool = True
    """Whether to run SUMO, too (automcm[sumo])."""

    @property
    def drawn_from(self) -> Values:
        """The target, and the ranges of the starts."""
        return {
            "target_m": self.target_m,
            "beside_m": [self.beside_m, self.beside_m + self.beside_span_m],
            "signal_m": [self.signal_m, self.signal_m + self.signal_span_m],
        }


def cells(settings: Settings) -> list[Values]:
    """The cells.  Those of SUMO come first, so that a missing SUMO is reported at once."""
    all_ = settings.model_dump(mode="json")
    places = {name: all_[name] for name in PLACES}
    model = {name: all_[name] for name in MODEL}
    tried = {name: all_[several] for name, several in MODEL.items()}
    found = grid(part="sumo", speed_kmh=SPEEDS_KMH, how=[*sumo.HOWS], draws=settings.trials)
    found = [each | {"places": places} for each in found if settings.sumo]
    for speed_kmh in SPEEDS_KMH:
        here: Values = {"speed_kmh": speed_kmh, "places": places, "model": model}
        found += [
            here | {"part": "trials", "trials": each["trials"], "block": BLOCK * each["block"]}
            for each in blocks(settings.trials, BLOCK)
        ]
        here |= {"draws": settings.draws}
        found += [here | {"part": "one", "name": name, "tried": tried[name]} for name in tried]
        here |= {"restart_gaps": tried["restart_gap"], "restarts_s": tried["restart_s"]}
        found += [here | one for one in grid(part="grid", brake=tried["brake"])]
    return found


def run(values: Values, seed: int) -> Values:
    """Run a cell.  Raises ExperimentError if a receiver does not arrive, or SUMO is missing."""
    if values["part"] == "trials":
        return _trials(values, Random(seed))
    if values["part"] == "sumo":
        return _in_sumo(values, seed)
    if values["part"] == "one":
        models = [values["model"] | {values["name"]: value} for value in values["tried"]]
        return {"gain_s": _gains(values, models)}
    flat = [
        values["model"] | {"brake": values["brake"], "restart_gap": gap, "restart_s": wait}
        for gap in values["restart_gaps"]
        for wait in values["restarts_s"]
    ]
    gains, width = _gains(values, flat), len(values["restarts_s"])
    return {"gain_s": [gains[n : n + width] for n in range(0, len(gains), width)]}


def _trials(values: Values, random: Random) -> Values:
    """Lists of results with one entry for each trial."""
    draws = [
        (drawn(values["places"], random.random(), random.random()), random.getrandbits(31))
        for _ in range(values["trials"])
    ]
    found: Values = {
        "beside_m": [round(beside_m, 3) for (beside_m, _), _ in draws],
        "signal_m": [round(signal_m, 3) for (_, signal_m), _ in draws],
    }
    for which in ("with", "without"):
        found[which] = columns(
            [
                drive(values, draw, values["model"], coordinated=which == "with", seed=seed)
                for draw, seed in draws
            ]
        )
    return found


def _gains(values: Values, models: Sequence[Values]) -> list[float]:
    """The mean gain in arrival time over each of these baselines, s."""
    draws = spread(values["places"], values["draws"])

    def average(model: Values, coordinated: bool) -> float:
        driven = (drive(values, draw, model, coordinated=coordinated) for draw in draws)
        return mean([one["arrival_s"] for one in driven])

    return [round(average(model, False) - average(model, True), 3) for model in models]


def _in_sumo(values: Values, seed: int) -> Values:
    places = values["places"]
    speed = values["speed_kmh"] / 3.6
    starts = spread(places, values["draws"])
    found = columns(
        [
            sumo.Trial(
                how=values["how"],
                speed=speed,
                beside_m=beside_m,
                signal_s=signal_m / speed,
                target_m=places["target_m"],
                seed=seed % 2**31,
            ).run()
            for beside_m, signal_m in starts
        ]
    )
    undisturbed = mean([(places["target_m"] - signal_m) / speed for _, signal_m in starts])
    return {
        "arrival_s": round(mean(found["arrival_s"]), 3),
        "lost_s": round(mean(found["arrival_s"]) - undisturbed, 3),
        "slowest": min(found["slowest"]),
        "hardest": max(found["hardest"]),
        "collisions": sum(found["collisions"]),
    }


def drawn(places: Values, first: float, second: float) -> Draw:
    """The start for two numbers from 0 to 1."""
    return (
        places["beside_m"] + first * places["beside_span_m"],
        places["signal_m"] + second * places["signal_span_m"],
    )


def spread(places: Values, number: int) -> list[Draw]:
    """Evenly spread starts with uncorrelated values, the same for all baselines."""
    golden = (5**0.5 - 1) / 2
    return [drawn(places, (n + 0.5) / number, (n * golden + 0.5) % 1) for n in range(number)]


def drive(values: Values, draw: Draw, model: Values, *, coordinated: bool, seed: int = 0) -> Values:
    """One drive: ``arrival_s`` since the signal; of the receiver ``slowest`` (m/s), how long it
    ``stood_s``, its ``hardest`` braking, and the hardest since the lane change began, ``after``
    (m/s²); and whether the session was ``completed``.  Raises ExperimentError if it does not
    arrive.
    """
    beside_m, signal_m = draw
    target_m, speed = values["places"]["target_m"], values["speed_kmh"] / 3.6
    signal_s, alone_s = round(signal_m / speed, 3), target_m / speed
    setting = FourVehicles(
        vehicles=2,
        speed_kmh=values["speed_kmh"],
        beside_m=beside_m,
        coordinated=coordinated,
        signal_s=signal_s,
        driving=Driving(acceleration=model["acceleration"]),
    )
    driven = setting.on(Simulation(seed=seed), driver=PaperLaneChange)
    for receiver in driven.drivers[1:]:
        receiver.vehicle.late = LateBraking(
            **{n: v for n, v in model.items() if n != "acceleration"}
        )
    until_s = alone_s + 5
    driven.run(until_s)
    while (arrival := arrival_s(driven.road.of(3), target_m - beside_m)) is None:
        until_s += 5
        if until_s > TOO_LATE * alone_s:
            raise ExperimentError(
                f"the receiver does not arrive: {values['speed_kmh']} km/h, {model}"
            )
        driven.run(until_s)
    samples = [sample for sample in driven.road.of(3) if sample.t <= arrival]
    begun = next((s.t for s in driven.road.of(1) if s.y != 0), arrival)
    return {
        "arrival_s": round(arrival - signal_s, 3),
        "slowest": round(min(s.speed for s in samples), 3),
        "stood_s": round(sum(s.speed == 0 for s in samples) * 0.1, 1),
        "hardest": round(max(0.0, *(-s.acceleration for s in samples)), 3),
        "after": round(max([0.0, *(-s.acceleration for s in samples if s.t >= begun)]), 3),
        "completed": int(any(kind == "Fin" for _, _, kind in driven.sent)),
    }
