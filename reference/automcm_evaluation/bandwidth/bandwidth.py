"""The cost of event-driven messages in bytes, compared with always-on trajectories (Fig. 7).

Sizes are those of payloads in both codecs; ``bandwidth_air`` measures them.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Annotated

from pydantic import Field

from automcm_evaluation.bandwidth import message_sizes as sizes
from automcm_evaluation.bandwidth.bandwidth_air import POINTS, measured, over_time, record, session
from automcm_evaluation.bandwidth.bandwidth_tables import MARKED, SPARSE_CAM_MS
from automcm_evaluation.framework.experiment import ExperimentSettings, Values, blocks, grid
from automcm_spec.vocabulary.messages import Cam
from automcm_spec.vocabulary.parameters import Parameters

TITLE = "Bytes on the air, event-driven and always on (Fig. 7)"
LOSSLESS = 2
"""Drives without loss, which differ only in delays."""
BLOCK = 5
"""Number of drives in a cell."""
IN_SERIES, SERIES_GAP_M = 3, 60.0
"""Where several change lanes one after another: receivers for each of them, and their gap, so wide
that each finds its receiver still beside it."""


class Settings(ExperimentSettings):
    """Drives of the paper's two and four vehicles, and of more."""

    trials: int = Field(default=2, ge=1, le=1000)
    """Drives with loss, of two vehicles and of four."""
    loss: float = Field(default=0.2, gt=0, le=0.9)
    """The variation; the paper's upper bound without obstacles is 20 % (VI-C)."""
    vehicles: tuple[Annotated[int, Field(ge=2, le=100)], ...] = Field((2, 4, 8), min_length=1)
    """In range of one another, one lane change at a time."""
    maneuvers: int = Field(default=2, ge=1, le=3)
    """By several prescribers one after another."""


def cells(settings: Settings) -> list[Values]:
    """Sizes; drives of two and four; drives of more; several lane changes in one drive."""
    found: list[Values] = [{"part": "sizes"}, {"part": "series", "maneuvers": settings.maneuvers}]
    for vehicles in (2, 4):
        for loss, trials in ((0.0, LOSSLESS), (settings.loss, settings.trials)):
            drives = {"part": "drive", "vehicles": vehicles, "loss": loss}
            found += [drives | block for block in blocks(trials, BLOCK)]
    usual = Parameters().max_participants
    for vehicles in settings.vehicles:
        most = sorted({usual, max(usual, vehicles - 1)})
        found += grid(part="many", vehicles=vehicles, participants=most)
    return found


def run(values: Values, seed: int) -> Values:
    """Run one cell; all its random numbers come from ``seed``."""
    drawn = random.Random(seed)
    match values["part"]:
        case "sizes":
            return _sizes()
        case "drive":
            return _drives(values, [drawn.randrange(2**32) for _ in range(values["trials"])])
        case "many":
            most = values["participants"]
            parameters = Parameters(
                t_cam=SPARSE_CAM_MS, max_participants=most, outbox_limit=2 * most
            )
            receivers = values["vehicles"] - 1
            recorded = record(receivers, [receivers // 2], seed=seed, parameters=parameters)
            return {"session": session(recorded, 1)}
        case _:
            number = values["maneuvers"]
            receivers = IN_SERIES * number
            recorded = record(
                receivers,
                # From the rear to the front, so that each finds its lane undisturbed.
                [receivers - 2 - IN_SERIES * n for n in range(number)],
                seed=seed,
                gap_m=SERIES_GAP_M,
                parameters=Parameters(t_cam=SPARSE_CAM_MS),
            )
            return {
                "vehicles": recorded.vehicles,
                "sessions": [session(recorded, n) for n in range(1, number + 1)],
            }


def _sizes() -> Values:
    """Bytes by type and codec, with a CAM outside and inside of a session."""
    cam = next(message for message in sizes.plain() if isinstance(message, Cam))
    found = {message.type: message for message in sizes.carrying(sizes.trajectory(POINTS))}
    plain = {message.type: message for message in sizes.plain() if message is not cam}
    whole = plain | found | {"CAM": cam.model_copy(update={"marks": ()}), MARKED: cam}
    return {name: measured(message) for name, message in whole.items()}


def _drives(values: Values, seeds: Sequence[int]) -> Values:
    receivers = values["vehicles"] - 1
    made = [record(receivers, [receivers // 2], seed=s, loss=values["loss"]) for s in seeds]
    found: Values = {"sessions": [session(each, 1) for each in made]}
    if values["block"] == 0 and values["loss"] == 0:
        found["time"] = over_time(made[0])
        planned = made[0].planned
        assert planned is not None
        (_, first, _), (_, second, _) = planned.points[:2]
        found["planned"] = {"points": len(planned.points), "apart_m": (second - first) / 1000}
    return found
