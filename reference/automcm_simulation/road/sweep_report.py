"""Drives of the occupancy sweep in several processes, and their counts (``simulate drives``)."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from itertools import repeat
from typing import Any

from automcm_simulation.road.occupancy_sweep import KINDS, SweptDrive, drive
from automcm_simulation.road.simulation import unwarned
from automcm_spec.support import children

FEW_DRIVES = 20
"""Too few drives for a process of their own."""


def driven(
    seeds: Sequence[int], without: str, workers: int, notify: Callable[[str], None]
) -> list[SweptDrive]:
    """The drives of these seeds, without a mechanism, in this order.  0: one per core."""
    found: list[SweptDrive] = []
    with ExitStack() as stack:
        workers = min(workers or os.cpu_count() or 1, len(seeds) // FEW_DRIVES + 1)
        if workers > 1:
            pool = stack.enter_context(children.pool(workers))
            results = pool.map(_drive, seeds, repeat(without), chunksize=10)
        else:
            results = map(_drive, seeds, repeat(without))
        for one in results:
            found.append(one)
            notify(f"{len(found)} of {len(seeds)} drives, {sum(d.bad for d in found)} bad")
    return found


@unwarned()  # of clocks out of step and messages too long
def _drive(seed: int, without: str) -> SweptDrive:
    return drive(seed, without)


def counted(found: Sequence[SweptDrive]) -> dict[str, Any]:
    """The outcomes by what B does, and each bad drive."""
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
    return {"kinds": kinds, "bad": [asdict(each) for each in found if each.bad]}
