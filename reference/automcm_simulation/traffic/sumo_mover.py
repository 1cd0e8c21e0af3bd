"""SUMO as the mover (Lopez et al., Microscopic traffic simulation using SUMO, 2018).

Needs the extra ``automcm[sumo]``; libsumo runs only one simulation in a process at a time.  A
vehicle without a station is SUMO's own driver.  One with a station keeps its distance by SUMO's
intelligent driver model, with the values that APP-3 assumes, and changes lanes only as its control
says; SUMO's sublane model moves it aside, so that a lane change takes its time and can turn back.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from automcm.applications.vehicle import LANE_WIDTH, STEP_S
from automcm.kernels.road_line import RoadLine
from automcm.kernels.trajectory import TrajectoryError
from automcm_simulation.traffic import lanelet_network
from automcm_simulation.traffic.mover import AUTOMATED, Body, RoadUser, TrafficError
from automcm_spec.support import scratch

NETWORKS = Path(__file__).parent / "networks"
"""Plain XML for netconvert (NAME.nod.xml, NAME.edg.xml), or a Lanelet2 map (NAME.osm)."""
SUBLANE_M = LANE_WIDTH / 4
REACHES_M = (20.0, 4.0)
"""Of a route's line, to the sides: the first that its bends allow."""
STRAIGHTEN_M = 0.05
"""Points of a lane that are nearer to each other are one."""
ASIDE = 2.0
"""The acceleration aside of an equipped vehicle, m/s²."""
TAKES_NO_LANE = 0
"""SUMO's lane change mode: only the control changes lanes."""
OWN_PRIORITY = 23
"""SUMO's speed mode: the control decides when to enter a junction; SUMO still keeps the distance
to vehicles ahead and to those inside it. It brakes for the control's speed with at most its
``decel``."""
BRAKES_HARD = OWN_PRIORITY - 4
"""The same without the bound on braking."""


def sumo_home() -> Path:
    """The folder of SUMO's programs.  Raises TrafficError if it is not installed."""
    try:
        return Path(import_module("sumo").SUMO_HOME)
    except ModuleNotFoundError as error:
        if error.name != "sumo":
            raise
        raise TrafficError("SUMO is missing: pip install 'automcm[sumo]'") from None


@cache
def network(name: str) -> bytes:
    """The network NAME of NETWORKS, made by netconvert once in a process.  Raises TrafficError."""
    command = [str(sumo_home() / "bin" / "netconvert"), "--no-warnings", "true"]
    with scratch.folder("network") as folder:
        made = folder / f"{name}.net.xml"
        plain = NETWORKS
        if (lanelets := NETWORKS / f"{name}.osm").exists():
            lanelet_network.write(lanelets, folder)
            plain = folder
            command += ["--offset.disable-normalization", "true"]  # the map's coordinates
        for option, ending in {"node": "nod", "edge": "edg", "connection": "con"}.items():
            if (file := plain / f"{name}.{ending}.xml").exists():
                command += [f"--{option}-files", str(file)]
        command += ["-o", str(made)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode or not made.exists():
            raise TrafficError(f"netconvert failed on {name}: {done.stderr.strip()[-300:]}")
        return made.read_bytes()


class SumoMover:
    """SUMO with these road users on a network.  Raises TrafficError without SUMO.

    ``folder`` takes its files.  ``gui`` opens sumo-gui.  ``cooperative``, from 0 to 1, is how
    willing SUMO's own drivers are to make room for others (lcCooperative; 1 is SUMO's default).
    """

    def __init__(
        self,
        users: Sequence[RoadUser],
        name: str,
        folder: Path,
        seed: int,
        gui: bool = False,
        cooperative: float = 1.0,
    ) -> None:
        if gui and sys.platform == "linux" and not os.environ.get("DISPLAY"):
            raise TrafficError("sumo-gui needs a display: DISPLAY is not set")
        net, routes = folder / f"{name}.net.xml", folder / f"{name}.rou.xml"
        net.write_bytes(network(name))
        self._sumo: Any = import_module("libsumo")
        self._users = {user.number: user for user in users}
        self._ids = {user.number: str(user.number) for user in users}
        self._half = {user.number: user.length / 2 for user in users}
        self._lines: dict[tuple[str, ...], RoadLine] = {}
        self._speed_modes: dict[int, int] = {}
        routes.write_text(_routes(users, cooperative), encoding="utf-8")
        program = "sumo-gui" if gui else "sumo"
        try:
            self._sumo.start(_command(program, net, routes, seed))
        except (self._sumo.TraCIException, self._sumo.FatalTraCIError) as error:
            raise TrafficError(f"{program} cannot start: {error}") from None
        for user in users:
            if user.kind != "person":
                self.line(user.route)  # for questions after the end, too
        self._bodies: dict[int, Body] = {}
        self.step()

    def line(self, route: tuple[str, ...]) -> RoadLine:
        """As ``Mover.line``."""
        if route not in self._lines:
            points: list[tuple[float, float]] = []
            for lane in _lanes(self._sumo, route):
                for x, y in self._sumo.lane.getShape(lane):
                    if (
                        not points
                        or math.hypot(x - points[-1][0], y - points[-1][1]) > STRAIGHTEN_M
                    ):
                        points.append((x, y))
            self._lines[route] = _line(points)
        return self._lines[route]

    def bodies(self) -> Mapping[int, Body]:
        """As ``Mover.bodies``."""
        return self._bodies

    def control(
        self, number: int, speed: float | None, aside: float, limit: float | None = None
    ) -> None:
        """As ``Mover.control``."""
        vehicle, name = self._sumo.vehicle, self._ids[number]
        if number not in self._speed_modes:
            vehicle.setLaneChangeMode(name, TAKES_NO_LANE)
        mode = OWN_PRIORITY if limit is None else BRAKES_HARD
        if self._speed_modes.get(number) != mode:
            vehicle.setSpeedMode(name, mode)
            self._speed_modes[number] = mode
        if limit is not None:
            least = self._bodies[number].speed - AUTOMATED.comfortable * STEP_S
            speed = limit if speed is None else min(max(speed, least), limit)
        vehicle.setSpeed(name, -1.0 if speed is None else speed)
        vehicle.changeSublane(name, aside)

    def step(self) -> None:
        """As ``Mover.step``."""
        sumo = self._sumo
        sumo.simulationStep()
        found = {}
        for domain in (sumo.vehicle, sumo.person):
            for name in domain.getIDList():
                x, y = domain.getPosition(name)
                heading = math.radians(90.0 - domain.getAngle(name))
                number = int(name)
                half = self._half[number]
                found[number] = Body(
                    x - half * math.cos(heading),
                    y - half * math.sin(heading),
                    heading,
                    domain.getSpeed(name),
                    domain.getAcceleration(name) if domain is sumo.vehicle else 0.0,
                )
        self._bodies = dict(sorted(found.items()))

    def close(self) -> None:
        """As ``Mover.close``."""
        self._sumo.close()


def _line(points: Sequence[tuple[float, float]]) -> RoadLine:
    *wider, least = REACHES_M
    for reach in wider:
        with suppress(TrajectoryError):
            return RoadLine(points, reach=reach)
    return RoadLine(points, reach=least)


def _lanes(sumo: Any, route: Sequence[str]) -> list[str]:
    """The rightmost lanes of a route, with those inside its junctions."""
    lanes = [f"{route[0]}_0"]
    for edge in route[1:]:
        links = sumo.lane.getLinks(lanes[-1])
        via = next((link[4] for link in links if link[0].rpartition("_")[0] == edge), "")
        while via:
            lanes.append(via)
            via = next((link[4] for link in sumo.lane.getLinks(via)), "")
        lanes.append(f"{edge}_0")
    return lanes


def _command(program: str, net: Path, routes: Path, seed: int) -> list[str]:
    options = {
        "net-file": net,
        "route-files": routes,
        "step-length": STEP_S,
        "lateral-resolution": SUBLANE_M,
        "collision.action": "warn",
        "collision.mingap-factor": 0,
        "collision.check-junctions": "true",
        "time-to-teleport": -1,
        "seed": seed,
        "no-step-log": "true",
        "no-warnings": "true",
        "xml-validation": "never",
    }
    if program == "sumo-gui":
        options |= {"start": "true", "quit-on-end": "true", "delay": 100}
    return [program, *(part for k, v in options.items() for part in (f"--{k}", str(v)))]


def _routes(users: Sequence[RoadUser], cooperative: float) -> str:
    """The route file: a type and a vehicle for each user, in the order of their begins."""
    d, lines = AUTOMATED, ["<routes>"]
    for user in sorted(users, key=lambda user: (user.begins_s, user.number)):
        edges = quoteattr(" ".join(user.route))
        if user.kind == "person":
            lines.append(
                f'<vType id="t{user.number}" vClass="pedestrian" length="{user.length}" '
                f'width="{user.width}" maxSpeed="{user.desired}" speedFactor="1" speedDev="0"/>'
                f'<person id="{user.number}" type="t{user.number}" depart="{user.begins_s}" '
                f'departPos="{user.at_m}"><walk edges={edges}/></person>'
            )
            continue
        drives = (
            f'carFollowModel="IDM" accel="{d.acceleration}" decel="{d.comfortable}" '
            f'emergencyDecel="{d.hardest}" tau="{d.headway_s}" minGap="{d.standstill}" '
            f'maxSpeedLat="{LANE_WIDTH / d.lane_change_s}" lcAccelLat="{ASIDE}"'
            if user.equipped
            else f'lcCooperative="{cooperative}"'
        )
        lines.append(
            f'<vType id="t{user.number}" length="{user.length}" width="{user.width}" '
            f'maxSpeed="{user.desired}" speedFactor="1" speedDev="0" {drives} '
            # The rear stays within a sublane of where followers take it to be: they take no account
            # of headings, and SUMO would move even a standing lorry aside, turned across lanes.
            f'lcMaxSpeedLatStanding="0" lcMaxSpeedLatFactor="{SUBLANE_M / user.length}"/>'
            f'<vehicle id="{user.number}" type="t{user.number}" depart="{user.begins_s}" '
            f'departLane="{user.lane}" departPos="{user.at_m}" departSpeed="{user.speed}" '
            f'insertionChecks="none"><route edges={edges}/></vehicle>'
        )
    return "\n".join([*lines, "</routes>", ""])
