"""Measures ns-3's radio, and fits the table of ``TableRadio`` to it.

    python -m automcm_evaluation.radio.radio_fit --measure   # needs automcm[radio]: 20 minutes
    python -m automcm_evaluation.radio.radio_fit             # from the counts kept in runs/

``--measure`` writes what arrived by distance to radio_ns3.json, with which the tests compare
the table, and counts by power and load to runs/radio_counts.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from automcm.kernels.trajectory import Floats
from automcm_evaluation.radio.radio_traffic import (
    MEASUREMENTS,
    NS3,
    STEP_MS,
    WARM_MS,
    Course,
    FourLanes,
    drive,
    measured,
    ns3_measured,
    positions,
)
from automcm_simulation.radio import table_radio
from automcm_simulation.radio.ns3_radio import Ns3Radio
from automcm_simulation.radio.propagation import BUSY_DBM, Propagation, airtime_us
from automcm_simulation.radio.table_radio import Bursts, FittedTable, hidden_airtime
from automcm_spec.support import files

FITTED = (
    FourLanes(name="10 per km", per_km=10, seconds=200),
    FourLanes(name="25 per km", per_km=25, seconds=60),
    FourLanes(name="50 per km", per_km=50, seconds=30),
    FourLanes(name="100 per km", per_km=100, seconds=10),
    FourLanes(name="150 per km", per_km=150, seconds=7),
    FourLanes(name="200 per km", per_km=200, seconds=4),
    FourLanes(name="200 per km, 20 Hz", per_km=200, seconds=1, period_ms=50),
)
CHECKED = (
    FourLanes(name="75 per km", per_km=75, seconds=40, seed=2, fitted=False),
    FourLanes(
        name="120 per km, 400 bytes",
        per_km=120,
        seconds=4,
        size_bytes=(400,),
        shares=(1.0,),
        seed=3,
        fitted=False,
    ),
    FourLanes(name="two jams", per_km=67, seconds=8, jams=True, seed=5, fitted=False),
)
"""Not used for the fit."""
MEAN_US = float(np.average([airtime_us(b) for b in FITTED[0].size_bytes], weights=FITTED[0].shares))
COUNTS = Path("runs/radio_counts")
TABLE = Path(table_radio.__file__).with_name("radio_table.json")


def measure() -> None:
    """Run ns-3 on every traffic that is not measured yet."""
    known = {m.traffic: m for m in (ns3_measured() if NS3.exists() else [])}
    files.folder(COUNTS, named=True)
    for traffic in FITTED + CHECKED:
        kept = COUNTS / f"{traffic.name}.npz"
        if traffic in known and (kept.exists() or not traffic.fitted):
            continue
        began = time.monotonic()
        radio = Ns3Radio(traffic.seed)
        try:
            course = drive(radio, traffic)
        finally:
            radio.close()
        if traffic.fitted:
            np.savez_compressed(kept, allow_pickle=False, **counts(course))
        known[traffic] = measured(traffic, course)
        found = [known[each] for each in FITTED + CHECKED if each in known]
        files.write(NS3, MEASUREMENTS.dump_json(found, indent=1) + b"\n")
        print(f"{traffic.name}: {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)


LOADS = np.arange(0, 2.001, 0.02)
POWERS = np.arange(-105, -29.0, 1.0)


def counts(course: Course) -> dict[str, Floats]:
    """What the fit needs: frames and arrivals by size, load and power; delays and busy by load."""
    kept = course.step >= WARM_MS // STEP_MS
    made = np.zeros((2, 2, len(LOADS), len(POWERS)))
    delays = np.zeros((len(LOADS), 600))
    for frame in np.flatnonzero(kept):
        step, sender = course.step[frame], course.sender[frame]
        power = course.mean_dbm[step, sender]
        near = (power >= POWERS[0]) & (power < POWERS[-1])
        load = np.minimum(course.share[step] / 0.02 + 0.5, len(LOADS) - 1).astype(np.intp)
        column = (power - POWERS[0] + 0.5).astype(np.intp)
        for which, mask in enumerate((near, near & course.hits[frame])):
            np.add.at(made[course.size[frame], which], (load[mask], column[mask]), 1)
        if course.size[frame] == 0 and course.delay_ms[frame] >= 0:
            delays[load[sender], min(course.delay_ms[frame], 599)] += 1
    busy = np.zeros((2, len(LOADS)))
    for step in range(WARM_MS // STEP_MS, len(course.share)):
        load = np.minimum(course.share[step] / 0.02 + 0.5, len(LOADS) - 1).astype(np.intp)
        np.add.at(busy[0], load, 1)
        np.add.at(busy[1], load, course.busy[step - 1])
    return {"made": made, "delays": delays, "busy": busy}


LOAD_NODES = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3)
POWER_NODES = tuple(float(dbm) for dbm in range(-104, -35, 2))
BURSTS = Bursts(
    far_dbm=-85.0, near_dbm=-70.0, far=0.58, near=0.22, fade=0.9, loss=0.8, mean_ms=3000.0
)
"""Of some tried, those with the smallest differences in the runs of losses."""
CROWDED = (0.25, 0.4)
DELAYS = 25
"""Equally likely delays of each load."""


def _hats(x: Floats, nodes: tuple[float, ...]) -> Floats:
    """The weights of the nodes in a linear interpolation, by x and node."""
    return np.array([np.interp(x, nodes, row) for row in np.eye(len(nodes))]).T


def _smooth(nodes: int, by: float) -> Floats:
    """Rows of a least-squares fit that prefer a straight line."""
    return by * np.diff(np.eye(nodes), 2, axis=0)


def delivery(made: Floats) -> Floats:
    """The share that arrives by load and power, of counts by load and power."""
    frames, hits = made
    load, power = np.nonzero(frames)
    n = frames[load, power]
    share = hits[load, power] / n
    weight = np.sqrt(n / (0.01 + share * (1 - share)))
    a = _hats(LOADS[load], LOAD_NODES)[:, :, None] * _hats(POWERS[power], POWER_NODES)[:, None, :]
    size = len(LOAD_NODES), len(POWER_NODES)
    by_load = np.kron(_smooth(size[0], 6.0), np.eye(size[1]))
    by_power = np.kron(np.eye(size[0]), _smooth(size[1], 6.0))
    rows = np.concatenate([weight[:, None] * a.reshape(len(n), -1), by_load, by_power])
    right = np.concatenate([weight * share, np.zeros(len(by_load) + len(by_power))])
    found = np.linalg.lstsq(rows, right, rcond=None)[0].reshape(size)
    falling = np.minimum.accumulate(np.clip(found, 0.0, 1.0), axis=0)
    return np.maximum.accumulate(falling, axis=1)


def busy_ratio(busy: Floats) -> Floats:
    """The channel busy ratio by load."""
    (known,) = np.nonzero(busy[0])
    weight = np.sqrt(busy[0, known])
    a = np.concatenate([weight[:, None] * _hats(LOADS[known], LOAD_NODES), _smooth(12, 6.0)])
    right = np.concatenate([weight * busy[1, known] / busy[0, known], np.zeros(10)])
    found = np.linalg.lstsq(a, right, rcond=None)[0]
    return np.maximum.accumulate(np.clip(found, 0.0, 1.0))


def delay_ms(delays: Floats) -> list[tuple[int, ...]]:
    """Equally likely delays by load; a load that did not occur has those of the next lower one."""
    near = _hats(LOADS, LOAD_NODES)
    found: list[tuple[int, ...]] = []
    for node in range(len(LOAD_NODES)):
        counted = np.cumsum(near[:, node] @ delays)
        if counted[-1] < 100:
            found.append(found[-1])
            continue
        at = (np.arange(DELAYS) + 0.5) / DELAYS * counted[-1]
        found.append(tuple(int(ms) for ms in np.searchsorted(counted, at)))
    return found


HIDDEN_M = tuple(25.0 * n for n in range(33))


def hidden() -> Floats:
    """The airtime of hidden stations, by distance, as a share of the load at the receiver."""
    frames, shares = np.zeros(len(HIDDEN_M)), np.zeros(len(HIDDEN_M))
    for traffic in FITTED:
        medium, n = Propagation(traffic.seed), traffic.vehicles
        airtime = np.full(n, MEAN_US / (1000 * traffic.period_ms))
        for _, places in zip(range(50), positions(traffic), strict=False):
            medium.move(places)
            load = (medium.mean_dbm >= BUSY_DBM) @ airtime + airtime
            pairs = ~np.eye(n, dtype=np.bool_)
            share = (hidden_airtime(medium.mean_dbm, airtime) / load[None, :])[pairs]
            weights = _hats(medium.distances()[pairs], HIDDEN_M)
            frames += weights.sum(axis=0)
            shares += weights.T @ share
    found: Floats = shares / frames
    return found


def fitted(bursts: Bursts) -> FittedTable:
    """The table of the kept counts.  Raises OSError without them."""
    parts = [np.load(COUNTS / f"{traffic.name}.npz") for traffic in FITTED]
    made, delays, busy = (sum(p[name] for p in parts) for name in ("made", "delays", "busy"))
    return FittedTable(
        source="ns-3 3.44 by automcm_evaluation.radio.radio_fit",
        size_bytes=(FITTED[0].size_bytes[0], FITTED[0].size_bytes[1]),
        frame_us=MEAN_US,
        hidden_m=HIDDEN_M,
        hidden=np.round(hidden(), 4).tolist(),
        crowded=CROWDED,
        load=LOAD_NODES,
        power_dbm=POWER_NODES,
        delivery=np.round([delivery(of) for of in made], 4).tolist(),
        busy=np.round(busy_ratio(busy), 4).tolist(),
        delay_ms=delay_ms(delays),
        bursts=bursts,
    )


def main() -> None:
    """Measure if asked to, and fit."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--measure", action="store_true", help="run ns-3 first")
    if parser.parse_args().measure:
        measure()
    files.write(TABLE, fitted(BURSTS).model_dump_json() + "\n")


if __name__ == "__main__":
    main()
