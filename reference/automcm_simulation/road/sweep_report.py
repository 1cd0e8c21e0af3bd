"""Drives of the occupancy sweep in several processes, and their counts (``simulate drives``)."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict
from multiprocessing import get_context
from typing import Any

from automcm_simulation.road.occupancy_sweep import KINDS, SweptDrive, drive
from automcm_spec.support import children

FEW_DRIVES = 20
"""Too few drives for a process of their own."""


def driven(
    asked: Sequence[tuple[int, str, float | None]], workers: int, notify: Callable[[str], None]
) -> list[SweptDrive]:
    """Each drive (seed, mechanism taken away, sigma), in this order.  0: one per core."""
    found: list[SweptDrive] = []
    with ExitStack() as stack:
        workers = min(workers or os.cpu_count() or 1, len(asked) // FEW_DRIVES + 1)
        if workers > 1:
            spawn = get_context("spawn")
            pool = ProcessPoolExecutor(workers, spawn, initializer=children.end_with_parent)
            results = stack.enter_context(pool).map(_drive, asked, chunksize=10)
        else:
            results = map(_drive, asked)
        for one in results:
            found.append(one)
            notify(f"{len(found)} of {len(asked)} drives, {sum(d.bad for d in found)} bad")
    return found


def _drive(asked: tuple[int, str, float | None]) -> SweptDrive:
    # Clocks out of step and messages too long are drawn on purpose: no warnings.
    logging.getLogger("automcm.service").setLevel(logging.ERROR)
    seed, without, sigma = asked
    return drive(seed, without, sigma=sigma)


def counted(found: Sequence[SweptDrive], sigmas: Sequence[float]) -> dict[str, Any]:
    """The outcomes by what B does and, if any are given, by position error, and each bad drive."""
    kinds = {
        kind: {
            "drives": len(some),
            "changed": sum(each.changed for each in some),
            "returned": sum(each.returned for each in some),
            "bad": sum(each.bad for each in some),
        }
        for kind in KINDS
        for some in [[each for each in found if each.kind == kind]]
    }
    errors = {
        sigma: {
            "completed": sum(each.changed for each in some),
            "aborted": sum(not each.changed for each in some),
            "bad": sum(each.bad for each in some),
        }
        for sigma in sigmas
        for some in [[each for each in found if each.sigma == sigma]]
    }
    bad = [asdict(each) for each in found if each.bad]
    return {"kinds": kinds, "bad": bad} | ({"sigmas": errors} if errors else {})
