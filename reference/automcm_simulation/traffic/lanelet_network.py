"""A Lanelet2 map as SUMO's network: SUMO moves everybody along its lanelets.

A lanelet with the tag ``turn_direction`` lies inside a junction and becomes a connection; any other
becomes an edge of one lane, named by its id.  So a street has one lane in each direction, and
nobody changes lanes.  Needs the extra ``automcm[map]``.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement

import numpy as np

from automcm.applications.vehicle import LANE_WIDTH
from automcm.kernels.trajectory import Floats
from automcm_simulation.road.lanelet_map import LaneMap, MapError
from automcm_simulation.traffic.mover import TrafficError

ORIGIN = 49.0, 8.4
"""Of the maps in ``networks``: latitude and longitude of x = 0 and y = 0."""
DIRECTION, SPEED = "turn_direction", "speed_limit"


@cache
def lane_map(path: Path) -> LaneMap:
    """The map.  Raises TrafficError if it cannot be read, or without Lanelet2."""
    try:
        return LaneMap(path, ORIGIN)
    except MapError as error:
        raise TrafficError(str(error)) from None


def write(path: Path, folder: Path) -> None:
    """The map as plain XML for netconvert, with the name of the map.  Raises TrafficError."""
    lanes = lane_map(path)
    after = {lane: lanes.next(lane) for lane in lanes.lanes()}
    roads = [lane for lane in after if lanes.tag(lane, DIRECTION) is None]
    turns = [lane for lane in after if lane not in roads]
    before = {lane: [road for road in roads if lane in after[road]] for lane in after}
    if lost := [turn for turn in turns if not before[turn] or not after[turn]]:
        raise TrafficError(f"{path}: the lanelets {lost} connect no others")
    over = [(a, turn, b) for turn in turns for a in before[turn] for b in after[turn]]
    direct = [(a, b) for b in roads for a in before[b]]
    ends = _joined(roads, [(a, b) for a, _, b in over] + direct)
    nodes, edges, connections = Element("nodes"), Element("edges"), Element("connections")
    for places in sorted({id(group): group for group in ends.values()}.values(), key=min):
        middle = np.mean([_middle(lanes, lane)[at] for lane, at in places], axis=0)
        kind = "priority" if len(places) > 1 else "dead_end"
        x, y = (f"{value:.3f}" for value in middle)
        SubElement(nodes, "node", id=_name(places), x=x, y=y, type=kind)
    for road in roads:
        try:
            speed = float(lanes.tag(road, SPEED) or "") / 3.6
        except ValueError:
            raise TrafficError(f"{path}: lane {road} has no {SPEED}, km/h") from None
        SubElement(
            edges,
            "edge",
            {"from": _name(ends[road, 0]), "to": _name(ends[road, -1])},
            id=str(road),
            numLanes="1",
            speed=f"{speed:.3f}",
            width=str(LANE_WIDTH),
            spreadType="center",
            shape=_shape(lanes, road),
        )
    for a, turn, b in over:
        ways = {"from": str(a), "to": str(b), "fromLane": "0", "toLane": "0"}
        SubElement(connections, "connection", ways, shape=_shape(lanes, turn))
    for ending, root in {"nod": nodes, "edg": edges, "con": connections}.items():
        ElementTree(root).write(folder / f"{path.stem}.{ending}.xml", encoding="unicode")


_Ends = set[tuple[int, int]]


def _joined(roads: list[int], pairs: list[tuple[int, int]]) -> dict[tuple[int, int], _Ends]:
    """The places at which roads begin (0) or end (-1): which of them are one place."""
    groups: dict[tuple[int, int], _Ends] = {(r, at): {(r, at)} for r in roads for at in (0, -1)}
    for a, b in pairs:
        both = groups[a, -1] | groups[b, 0]
        groups |= dict.fromkeys(both, both)
    return groups


def _name(places: _Ends) -> str:
    lane, at = min(places)
    return f"{'end' if at else 'begin'}_of_{lane}"


def _shape(lanes: LaneMap, lane: int) -> str:
    return " ".join(f"{x:.3f},{y:.3f}" for x, y in _middle(lanes, lane))


def _middle(lanes: LaneMap, lane: int) -> Floats:
    """The points of its centre line, also where it bends as sharply as a lane can."""
    try:
        return lanes.line([lane], reach=LANE_WIDTH / 2).xy
    except MapError as error:
        raise TrafficError(str(error)) from None
