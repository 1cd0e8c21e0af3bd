"""Lanes from a Lanelet2 map, as polygons for KIN-4 and as road lines (extra ``automcm[map]``)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from automcm.kernels.road_line import REACH_M, RoadLine
from automcm.kernels.trajectory import NANOMETRE, Floats, TrajectoryError, array


class MapError(Exception):
    """A map cannot be read, or a lane does not exist; the text names it."""


class LaneMap:
    """A Lanelet2 map in metres east (x) and north (y) of ``origin`` (latitude, longitude).

    North is that of the UTM grid, which deviates from true north off the zone's meridian.

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
            self._map: Any = lanelet2.io.load(str(path), projector)
        except RuntimeError as error:
            raise MapError(f"{path}: {error}") from None

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
