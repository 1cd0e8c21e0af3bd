"""The lane change of section VI-B in SUMO, as an independent measurement of a gap's cost.

SUMO's followers use its own driver model, without late notice and stop.  Each trial is a straight
road of two lanes, a prescriber that changes from the right to the left lane, and a receiver there.
Needs the extra ``automcm[sumo]``; libsumo runs only one simulation in a process at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from automcm.applications.lane_change import Plan
from automcm.applications.planning import gained_at
from automcm.applications.vehicle import STEP_S, Driving
from automcm.kernels.prescribe import prescribe
from automcm.kernels.trajectory import Trajectory
from automcm_evaluation.framework.experiment import ExperimentError, captions
from automcm_spec.support import scratch
from automcm_spec.vocabulary.parameters import Parameters

How = Literal["cooperative", "forced", "prescribed"]
HOWS = captions("arrival", "hows")
SAFE, AT_ONCE = 1621, 0
"""SUMO's lane change modes: its default, and regardless of others."""
DECIDED_S = Parameters().t_timeout / 1000 + 0.1
"""Time from the signal to the Prescription: the window for Intentions, then the choice."""
BEGIN_M = 50.0
"""The receiver's start; SUMO inserts a vehicle with its complete length."""
TOO_LATE = 10
"""Time limit for an arrival, as a multiple of the undisturbed travel time."""
CAR_M = 4.5
NET = """<net version="1.16">
<edge id="road" from="a" to="b">
<lane id="road_0" index="0" speed="60" length="{m}" shape="0,-4.8 {m},-4.8"/>
<lane id="road_1" index="1" speed="60" length="{m}" shape="0,-1.6 {m},-1.6"/>
</edge>
<junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape=""/>
<junction id="b" type="dead_end" x="{m}" y="0" incLanes="road_0 road_1" intLanes="" shape=""/>
</net>
"""
ROUTES = """<routes>
<vType id="car" length="{length}" maxSpeed="{speed}" speedFactor="1" speedDev="0" sigma="0"
 lcKeepRight="0" lcSpeedGain="0"/>
<route id="all" edges="road"/>
<vehicle id="prescriber" type="car" route="all" depart="0" departLane="0" departPos="{ahead}"
 departSpeed="{speed}"/>
<vehicle id="receiver" type="car" route="all" depart="0" departLane="1" departPos="{begin}"
 departSpeed="{speed}"/>
</routes>
"""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One trial, in SI units.  ``beside_m``: how far the prescriber is ahead, centre to centre.
    ``signal_s``: time of the signal from the start.  ``target_m``: distance of the target from the
    start of the receiver."""

    how: How
    speed: float
    beside_m: float
    signal_s: float
    target_m: float = 260.0
    seed: int = 0

    def run(self) -> dict[str, float]:
        """``arrival_s`` since the signal, ``slowest`` and ``hardest`` braking of the receiver
        (m/s, m/s²), and ``collisions`` as SUMO counts them.

        Raises ExperimentError without SUMO, or if the receiver does not arrive.
        """
        sumo = libsumo()
        with scratch.folder("sumo") as folder:
            sumo.start(self._command(folder))
            try:
                return self._drive(sumo)
            finally:
                sumo.close()

    def _command(self, folder: Path) -> list[str]:
        net, routes = folder / "road.net.xml", folder / "road.rou.xml"
        net.write_text(NET.format(m=BEGIN_M + self.beside_m + 3 * self.target_m), encoding="utf-8")
        routes.write_text(
            ROUTES.format(
                length=CAR_M, speed=self.speed, begin=BEGIN_M, ahead=BEGIN_M + self.beside_m
            ),
            encoding="utf-8",
        )
        options = {
            "net-file": net,
            "route-files": routes,
            "step-length": STEP_S,
            "lanechange.duration": Driving().lane_change_s,
            "collision.action": "warn",
            "seed": self.seed,
            "no-step-log": "true",
            "no-warnings": "true",
            "xml-validation": "never",
        }
        return ["sumo", *(part for k, v in options.items() for part in (f"--{k}", str(v)))]

    def _drive(self, sumo: Any) -> dict[str, float]:
        sumo.simulationStep()  # inserts the vehicles without moving them
        begin_s = float(sumo.simulation.getTime())
        slower, moves_s = self.slower()
        samples = [(0.0, BEGIN_M, self.speed)]
        collisions, moved, too_late_s = 0, False, TOO_LATE * self.target_m / self.speed
        while samples[-1][1] < BEGIN_M + self.target_m:
            now = samples[-1][0]
            if now > self.signal_s + too_late_s:
                raise ExperimentError(f"SUMO: the receiver does not arrive: {self}")
            if not moved and now >= moves_s - 1e-6:
                mode = SAFE if self.how == "cooperative" else AT_ONCE
                sumo.vehicle.setLaneChangeMode("prescriber", mode)
                sumo.vehicle.changeLane("prescriber", 1, too_late_s)
                moved = True
            if slower is not None and now >= slower.t[0]:
                at = int(np.searchsorted(slower.t, now, side="right")) - 1
                over = now >= moves_s + Driving().lane_change_s
                sumo.vehicle.setSpeed("receiver", -1 if over else float(slower.speeds()[at]))
            sumo.simulationStep()
            collisions += int(sumo.simulation.getCollidingVehiclesNumber())
            samples.append(
                (
                    float(sumo.simulation.getTime()) - begin_s,
                    float(sumo.vehicle.getLanePosition("receiver")),
                    float(sumo.vehicle.getSpeed("receiver")),
                )
            )
        (t0, x0, _), (t1, x1, _) = samples[-2:]
        arrival = t0 + (t1 - t0) * (BEGIN_M + self.target_m - x0) / (x1 - x0)
        return {
            "arrival_s": round(arrival - self.signal_s, 3),
            "slowest": round(min(speed for _, _, speed in samples), 3),
            "hardest": round(max(a[2] - b[2] for a, b in pairwise(samples)) / STEP_S, 3),
            "collisions": collisions,
        }

    def slower(self) -> tuple[Trajectory | None, float]:
        """The prescription, if there is one, and the time of the lane change, s."""
        if self.how != "prescribed":
            return None, self.signal_s
        plan, decided = Plan(), self.signal_s + DECIDED_S
        way = np.array([0.0, 4 * self.target_m])
        alone = Trajectory(decided + way / self.speed, np.column_stack([way, 0 * way]))
        asked = prescribe(
            alone,
            decided,
            hold=plan.hold_s,
            delta_v=plan.delta_v,
            gain=plan.gain_m,
            v_min=plan.v_min,
        )
        return asked, gained_at(alone, asked, plan.gain_m)


def libsumo() -> Any:
    """The module libsumo.  Raises ExperimentError if it is not installed."""
    if find_spec("libsumo") is None:
        raise ExperimentError(
            "the comparison with SUMO needs it: pip install 'automcm[sumo]', or --set sumo=false"
        )
    return import_module("libsumo")
