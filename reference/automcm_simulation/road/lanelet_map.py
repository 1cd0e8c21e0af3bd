"""Lanes from a Lanelet2 map, as polygons for KIN-4 and as road lines (extra ``automcm[map]``)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ElementTree, ParseError, parse

import numpy as np

from automcm.kernels.road_line import REACH_M, RoadLine
from automcm.kernels.trajectory import NANOMETRE, Floats, TrajectoryError, array
from automcm_spec.support import scratch


class MapError(Exception):
    """A map cannot be read, or a lane does not exist; the text names it."""


class LaneMap:
    """A Lanelet2 map (.osm) in metres east (x) and north (y) of ``origin`` (latitude, longitude).

    North is that of the UTM grid, which deviates from true north off the zone's meridian. Only the
    lanelets are read, with their bounds: no regulatory elements, no areas.

    Raises MapError if the file cannot be read, or if Lanelet2 is not installed.
    """

    def __init__(self, path: Path, origin: tuple[float, float]) -> None:
        try:
            import lanelet2
        except ImportError:
            raise MapError("Lanelet2 is not installed: pip install 'automcm[map]'") from None
        self._path = path
        projector = lanelet2.projection.UtmProjector(lanelet2.io.Origin(*origin))
        try:
            with scratch.folder("map") as folder:
                lanelets = folder / "lanelets.osm"
                _lanelets(path).write(lanelets)
                self._map: Any = lanelet2.io.load(str(lanelets), projector)
        except OSError as error:
            raise MapError(f"{path}: {error.strerror}") from None
        except (ParseError, RuntimeError) as error:
            problems = str(error).splitlines()[1:] or [str(error)]  # Lanelet2's first is a title
            first = problems[0].strip("\t- ")
            raise MapError(f"{path}: {first}{_more(problems)}") from None

    def lanes(self) -> list[int]:
        """The ids of all lanelets."""
        return sorted(lane.id for lane in self._map.laneletLayer)

    def tag(self, lane: int, name: str) -> str | None:
        """An attribute of a lanelet, as in the file; None if it has none of this name.

        Raises MapError if the lanelet does not exist.
        """
        try:
            attributes = self._map.laneletLayer[lane].attributes
        except RuntimeError as error:
            raise MapError(f"{self._path}: lane {lane}: {error}") from None
        return str(attributes[name]) if name in attributes else None

    def next(self, lane: int) -> list[int]:
        """The lanelets that begin where this one ends, with both bounds."""
        ends = self._ends(lane, -1)
        return [other for other in self.lanes() if self._ends(other, 0) == ends]

    def _ends(self, lane: int, place: int) -> tuple[int, int]:
        """The points of both bounds at its begin (0) or end (-1)."""
        found = self._map.laneletLayer[lane]
        return found.leftBound[place].id, found.rightBound[place].id

    def zone(self, lane: int) -> Floats:
        """The lanelet with this id as a polygon, shape (n, 2).

        Raises MapError if it does not exist.
        """
        try:
            corners = [(p.x, p.y) for p in self._map.laneletLayer[lane].polygon2d()]
            return array("zone", np.array(corners), 2)
        except (RuntimeError, TrajectoryError) as error:
            raise MapError(f"{self._path}: lane {lane}: {error}") from None

    def line(self, lanes: Sequence[int], reach: float = REACH_M) -> RoadLine:
        """The centre line of lanelets in the order in which they are driven.

        Raises MapError if one does not exist, or if the line is none (``RoadLine``).
        """
        try:
            places = [(p.x, p.y) for lane in lanes for p in self._map.laneletLayer[lane].centerline]
            xy = array("centre line", np.array(places), 2)
            apart = np.hypot(*np.diff(xy, axis=0).T) > NANOMETRE  # a lanelet begins where one ends
            return RoadLine(xy[np.concatenate([[True], apart])], reach)
        except (RuntimeError, TrajectoryError) as error:
            raise MapError(f"{self._path}: lanes {[*lanes]}: {error}") from None


_USED = {"left", "right", "centerline"}
"""The roles of the members of a lanelet that are read."""


def _lanelets(path: Path) -> ElementTree[Element]:
    """The lanelets in a map, with their ways and nodes, and nothing else.

    Lanelet2 rejects a map with a regulatory element that it does not know. Raises OSError,
    ParseError, and MapError if a node has no place.
    """
    given = parse(path).getroot()
    found = Element(given.tag, given.attrib)
    lanelets = [
        r for r in given.iter("relation") if r.find("tag[@k='type'][@v='lanelet']") is not None
    ]
    for lanelet in lanelets:
        for member in lanelet.findall("member"):
            if member.get("role") not in _USED:
                lanelet.remove(member)
    named = {member.get("ref") for lanelet in lanelets for member in lanelet.iter("member")}
    ways = [way for way in given.iter("way") if way.get("id") in named]
    named = {point.get("ref") for way in ways for point in way.iter("nd")}
    nodes = [node for node in given.iter("node") if node.get("id") in named]
    nowhere = [node for node in nodes if not node.get("lat") or not node.get("lon")]
    if nowhere:
        name = f"{path}: node {nowhere[0].get('id')}"
        raise MapError(
            f"{name}: has no lat and lon; local_x and local_y are not read{_more(nowhere)}"
        )
    found.extend([*nodes, *ways, *lanelets])
    return ElementTree(found)


def _more(problems: Sequence[object]) -> str:
    return f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
