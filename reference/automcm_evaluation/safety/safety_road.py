"""Distances of the four vehicles of Fig. 6 under faults, with and without mechanisms."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from automcm.applications.lane_change import LaneChange, PaperLaneChange
from automcm.applications.vehicle import LateBraking, Vehicle
from automcm.links.simulated_radio import Channel
from automcm_evaluation.framework.experiment import Values
from automcm_evaluation.safety.ablations import BY_NAME, WHOLE
from automcm_evaluation.safety.faults import CUTS, Roles, drawn, inject
from automcm_simulation.road.drive import STEP_MS, FourVehicles, SimulatedDrive
from automcm_simulation.road.hazard_measures import Watched, bound_ms, met
from automcm_simulation.road.road import Sample

ROLES = Roles(prescriber=1, target=3)
UNCOORDINATED = "no coordination"
"""The prescriber changes lanes without coordination, the paper's baseline."""
LOOKS = "whole protocol, APP-1 to APP-5"
"""The prescriber also uses the CAMs that it hears; elsewhere it only counts answers, as the
paper's."""
PROTOCOLS = (
    WHOLE.name,
    LOOKS,
    "no CAM-loss fallback",
    "silent CAM-loss fallback",
    "plain CAMs count",
    "no lease",
    "Acceptance abandoned",
    "no retransmission",
    UNCOORDINATED,
)
KINDS = (*CUTS, "target aborts", "target restarts", "target crashes")
"""Faults that can leave a prescriber alone with its maneuver."""
WINDOWS_MS = {"negotiation": (1000, 3100), "maneuver": (3100, 12_800)}
"""When a fault begins: from the first Advertisement to the agreement, or from then to the end of
the lane change, both if undisturbed."""
LOSSES = (0.0, 0.3, 0.6)
BESIDE_M = (0.0, 4.0)
"""The target's initial distance behind the prescriber, centre to centre."""
UNTIL_S = 24.0
NEAR_M = 2.0
"""The limit of little room at the beginning of the lane change."""
WIDTH_M = 1.8
"""Width of a vehicle; two vehicles conflict if their sides overlap."""


def run(values: Values, seeds: Sequence[int]) -> Values:
    """The drives of a cell: distances and hardest braking of each, and hazards.

    A distance is None for a drive without a lane change.
    """
    ablation = BY_NAME.get(values["ablation"], WHOLE)
    drives = [drive(values, seed) for seed in seeds]
    b = bound_ms(ablation.parameters, values["delay_ms"])
    measured = {
        name: [None if d[name] is None else round(d[name], 2) for d in drives]
        for name in ("room_m", "gap_m", "ttc_s", "braking")
    }
    counts = {name: sum(d[name] for d in drives) for name in ("begun", "unasked")}
    return met(seeds, [d["hazards"] for d in drives], b) | measured | counts


def drive(values: Values, seed: int, logs: Path | None = None) -> Values:
    """One drive: a fault that begins in the given one of WINDOWS_MS, and loss.

    The results are the distances of ``nearest``, the hardest ``braking`` of a receiver (m/s²), the
    ``hazards``, and whether it changed lanes during one (``begun``) or ``unasked``: without an
    agreement.

    A target that is committed at the beginning of the lane change follows the prescriber from then
    on; all other vehicles notice it late (road.Late).
    """
    draw = random.Random(seed)
    name = values["ablation"]
    channel = Channel(loss=draw.choice(LOSSES), duplicate=0.1, delay_ms=(2, values["delay_ms"]))
    faults = drawn([draw.choice(KINDS)], WINDOWS_MS[values["begins"]], draw)
    setting = FourVehicles(
        speed_kmh=values["speed_kmh"],
        beside_m=draw.uniform(*BESIDE_M),
        coordinated=name != UNCOORDINATED,
        until_s=UNTIL_S,
    )
    ablation = BY_NAME.get(name, WHOLE)
    watched = Watched(seed=seed, channel=channel, logs=logs)
    application = LaneChange if name == LOOKS else PaperLaneChange
    made = setting.on(watched, ablation.parameters, application)
    _informed(made, watched)
    inject(faults, watched, ROLES)
    with ablation.applied():
        made.run(UNTIL_S)
    prescriber, samples, hazards = made.drivers[0], made.road.samples, watched.over()
    assert isinstance(prescriber, LaneChange)
    room, gap, ttc = nearest(samples, prescriber.vehicle)
    moved = [t for t, what in prescriber.story if what == "moves over"]
    return {
        "room_m": room,
        "gap_m": gap,
        "ttc_s": ttc,
        "braking": -min(s.acceleration for s in samples if s.station_id != ROLES.prescriber),
        "hazards": hazards,
        # it acts no longer than that
        "begun": any(t < h.until_ms for t in moved for h in hazards),
        "unasked": room is not None and not watched.agreed,
    }


def _informed(made: SimulatedDrive, watched: Watched) -> None:
    """The vehicles that notice late are determined at the beginning of the lane change."""
    prescriber, *others = (driver.vehicle for driver in made.drivers)
    for vehicle in others:
        vehicle.late = LateBraking()
    (target,) = (vehicle for vehicle in others if vehicle.station_id == ROLES.target)

    def look() -> None:
        if not prescriber.changing:
            target.late = None if watched.committed(ROLES.target) else LateBraking()
            watched.clock.at(watched.clock.now() + STEP_MS, look)

    watched.clock.at(0, look)


def nearest(
    samples: Sequence[Sample], vehicle: Vehicle
) -> tuple[float | None, float | None, float | None]:
    """The distances of this vehicle to others during and after its lane change.

    They are the room along the road at its beginning, m; and the least gap, m, and the least time
    to collision, s, to any vehicle whose side overlaps with its own.  All are bumper to bumper; a
    negative gap is a collision.  A value is None without a lane change, without a vehicle beside
    it, or without an approach.
    """
    ids = sorted({s.station_id for s in samples})
    of = {n: np.array([(s.x, s.y, s.speed) for s in samples if s.station_id == n]) for n in ids}
    own = of.pop(vehicle.station_id)
    moved = np.flatnonzero(own[:, 1] != own[0, 1])
    if not len(moved):
        return None, None, None
    first = int(moved[0]) - 1
    own = own[first:]
    rooms, gaps, times = [], [], []
    for other in (all_[first:] for all_ in of.values()):
        ahead = other[:, 0] - own[:, 0]
        gap = np.abs(ahead) - vehicle.length
        rooms.append(float(gap[0]))
        there = np.abs(other[:, 1] - own[:, 1]) < WIDTH_M
        gaps += gap[there].tolist()
        closing = np.sign(ahead) * (own[:, 2] - other[:, 2])
        near = there & (closing > 0.1)
        times += (np.maximum(gap[near], 0.0) / closing[near]).tolist()
    return min(rooms), min(gaps, default=None), min(times, default=None)
