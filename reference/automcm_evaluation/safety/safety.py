"""Hazards under random faults, compared with the proved bound, also without single mechanisms.

This is not in the paper.  There are two harnesses: the protocol alone (Straight), in which
thousands of maneuvers are cheap, and the four vehicles of Fig. 6 on the road, in which distances
can be measured.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field

from automcm.links.simulated_radio import Channel
from automcm_evaluation.framework.experiment import ExperimentSettings, Values, grid
from automcm_evaluation.safety import safety_road
from automcm_evaluation.safety.ablations import BY_NAME, WHOLE, Ablation
from automcm_evaluation.safety.faults import KINDS, Injected, Roles, drawn, inject
from automcm_simulation.road.hazard_measures import Watched, bound_ms, met
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.parameters import Parameters

TITLE = "Hazards under random faults"
ROLES = Roles(prescriber=1001, target=2002, second=3003)
REQUEST_MS = 500
WINDOW_MS = (REQUEST_MS, 13_000)
"""The window of faults: from the request to about the end of the longest maneuver."""
MANEUVER_MS = (2000, 12_000)
LEASE_MS = 10_000
"""Shorter than the longest maneuver, so that some leases expire."""
REFUSES, ASKS_AGAIN, NEVER_ENDS = 0.2, 0.25, 0.05
"""The shares of runs in which the first proposal is refused, in which another maneuver is
requested, and in which the prescriber never ends its maneuver."""
LONGEST_MS = 50_000
"""An upper bound of the time for which a station is in a session (T-1, with a second maneuver)."""
LOSSES = (0.0, 0.2, 0.4, 0.6)
NOTHING = "nothing but loss"
SEVERAL = "two or three faults"
CLASSES = ("cut both ways", "cut forth", "cut back", "target aborts", "target restarts")
"""The fault classes of the table in docs/verification.md, section 4, with a perfect radio."""
CLASS_ABLATIONS = (WHOLE.name, "silent CAM-loss fallback", "plain CAMs count")


class Settings(ExperimentSettings):
    """The numbers of simulated maneuvers."""

    drives: int = Field(60, ge=1, le=10_000)
    """With the complete protocol, for each fault at each loss."""
    ablated: int = Field(300, ge=1, le=10_000)
    """With faults of all kinds, without each mechanism, and with the complete protocol."""
    classes: int = Field(60, ge=1, le=10_000)
    """For each fault class, with a perfect radio, for three protocols."""
    road: int = Field(60, ge=1, le=10_000)
    """On the road at each speed, with each protocol and each window of faults."""
    block: int = Field(20, ge=1, le=1000)
    """Drives on the road in one cell."""
    speeds_kmh: tuple[Annotated[int, Field(ge=10, le=130)], ...] = Field(
        (30, 50), min_length=1, max_length=8
    )
    delay_ms: int = Field(40, ge=2, le=49)
    """The longest delay of a copy, D; T-2 supposes less than half of t_resend."""


def cells(settings: Settings) -> list[Values]:
    """The parts: faults by loss, mechanisms, fault classes, and the road."""
    s = settings
    found = grid(part="faults", fault=(NOTHING, *KINDS, SEVERAL), loss=LOSSES, drives=s.drives)
    found += grid(part="mechanisms", ablation=[*BY_NAME], drives=s.ablated)
    found += grid(part="classes", ablation=CLASS_ABLATIONS, fault=CLASSES, drives=s.classes)
    windows = [*safety_road.WINDOWS_MS]
    found += [
        one | {"first": first, "drives": min(s.block, s.road - first)}
        for one in grid(
            part="road", ablation=safety_road.PROTOCOLS, speed_kmh=s.speeds_kmh, begins=windows
        )
        for first in range(0, s.road, s.block)
    ]
    return [each | {"delay_ms": s.delay_ms} for each in found]


def run(values: Values, seed: int) -> Values:
    """Run one cell: the combined results of its drives, each with its own seed."""
    draw = random.Random(seed)
    seeds = [draw.getrandbits(32) for _ in range(values["drives"])]
    if values["part"] == "road":
        return safety_road.run(values, seeds)
    ablation = BY_NAME[values.get("ablation", WHOLE.name)]
    b = bound_ms(ablation.parameters, values["delay_ms"])
    outcomes = [outcome(drive(values, one), b) for one in seeds]
    found = met(seeds, [each.pop("hazards") for each in outcomes], b)
    found |= {name: sum(each[name] for each in outcomes) for name in outcomes[0]}
    if values["part"] == "classes":
        formula, ms = class_bound(values, ablation)
        found |= {"class_bound": formula, "class_bound_ms": ms}
    return found


def class_bound(values: Values, ablation: Ablation) -> tuple[str, int]:
    """The bound of a fault class with a perfect radio, as a formula and in ms: the table of
    docs/verification.md, section 4."""
    formula = {
        "cut both ways": "C + D",
        "cut forth": "D",
        "cut back": "0",
        "target aborts": "D",
        "target restarts": "D + L",
    }[values["fault"]]
    if (ablation.name, values["fault"]) == ("silent CAM-loss fallback", "cut forth"):
        formula = "D + L"
    elif (ablation.name, values["fault"]) == ("plain CAMs count", "target restarts"):
        formula = "E"
    p = ablation.parameters
    ms = {"C": p.t_cam, "D": values["delay_ms"], "L": p.t_cam_loss, "E": LEASE_MS, "0": 0}
    return formula, sum(ms[symbol] for symbol in formula.split(" + "))


def drive(values: Values, seed: int, logs: Path | None = None) -> Watched:
    """One run of a cell without a road, to its end; ``seed`` draws faults and applications."""
    draw, part = random.Random(seed), values["part"]
    loss = values["loss"] if part == "faults" else 0.0
    if part == "mechanisms":
        loss = draw.choice(LOSSES)
        kinds = draw.sample(KINDS, draw.choices((0, 1, 2), (2, 5, 3))[0])
    elif values["fault"] == SEVERAL:
        kinds = draw.sample(KINDS, draw.choice((2, 3)))
    else:
        kinds = [values["fault"]] if values["fault"] != NOTHING else []
    faults = drawn(kinds, WINDOW_MS, draw)
    maneuver_ms = 10 * LONGEST_MS if draw.random() < NEVER_ENDS else draw.randint(*MANEUVER_MS)
    refuses = int(draw.random() < REFUSES)
    again_ms = draw.randint(*WINDOW_MS) if draw.random() < ASKS_AGAIN else 0
    channel = Channel(loss=loss, duplicate=0.1, delay_ms=(2, values["delay_ms"]))
    watched = Watched(seed=seed, channel=channel, logs=logs)
    ablation = BY_NAME[values.get("ablation", WHOLE.name)]
    with ablation.applied():
        simulate(watched, ablation.parameters, faults, maneuver_ms, refuses, again_ms)
    return watched


def simulate(
    watched: Watched,
    parameters: Parameters,
    faults: Sequence[Injected],
    maneuver_ms: int,
    refuses: int = 0,
    again_ms: int = 0,
) -> None:
    """Run a prescriber, its target, and optionally a second prescriber, until all are idle.

    ``again_ms``: the time at which the prescriber requests another maneuver; 0: never.
    """
    ids = [ROLES.prescriber, ROLES.target]
    if any(fault.kind == "second prescriber" for fault in faults):
        ids.append(ROLES.second)
    for station_id in ids:
        driver = Straight(
            target=ROLES.target,
            maneuver_ms=maneuver_ms,
            lease_ms=LEASE_MS,
            refuse_first=refuses,
        )
        watched.add(station_id, driver, parameters)
    watched.request(ROLES.prescriber, REQUEST_MS)
    if again_ms:
        watched.request(ROLES.prescriber, again_ms)
    last = max(inject(faults, watched, ROLES), again_ms, REQUEST_MS)
    watched.clock.run(last + 1)
    while not watched.idle and watched.clock.now() < LONGEST_MS:
        watched.clock.run(watched.clock.now() + 500)
    watched.run(watched.clock.now())


def outcome(watched: Watched, b: int) -> Values:
    """The ``hazards`` of a run, whether some are ``unexcused`` or ``beyond`` B, and whether any
    session ``agreed``; the number of ``maneuvers`` agreed, of those ``completed`` by a Fin, and
    ``in_vain``: the target did not get it; whether a station is ``stuck`` in a session."""
    hazards = watched.over()
    return {
        "hazards": hazards,
        "unexcused": any(not hazard.excuse for hazard in hazards),
        "beyond": any(hazard.length_ms > b for hazard in hazards),
        "agreed": bool(watched.agreed),
        "maneuvers": len(watched.agreed),
        "completed": len(watched.completed),
        "in_vain": len(watched.completed - watched.finished),
        "stuck": not watched.idle,
    }
