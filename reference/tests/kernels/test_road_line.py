"""A road's centre line: positions along and across it, and back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from automcm.kernels.road_line import BLOCK, CHUNK, RoadLine
from automcm.kernels.trajectory import TrajectoryError
from automcm_simulation.road.occupancy_sweep import bends

ARC = bends(100.0, True, 1500.0)

turns = st.lists(st.floats(-0.3, 0.3), min_size=1, max_size=3 * BLOCK)


def line_of(angles: list[float]) -> RoadLine:
    """Segments of 10 m that turn by these angles (rad) by turns to either side."""
    heading = np.cumsum([0.0, *(abs(a) * (-1) ** n for n, a in enumerate(angles))])
    steps = 10 * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return RoadLine(np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), 15.0)


@given(turns, st.lists(st.tuples(st.floats(-50, 600), st.floats(-14.9, 14.9)), min_size=1))
@settings(deadline=None)
def test_the_projection_is_the_inverse_of_the_place(
    angles: list[float], positions: list[tuple[float, float]]
) -> None:
    line = line_of(angles)
    s, d = np.array(positions).T
    places = line.place(s, d)
    found = line.project(places)
    assert found.s == pytest.approx(s, abs=1e-7) and found.d == pytest.approx(d, abs=1e-9)
    poses = np.array([line.pose(*each) for each in positions])
    assert poses[:, :2] == pytest.approx(places, abs=1e-9)
    assert found.scale == pytest.approx([line.scale(*each) for each in positions], abs=1e-6) or any(
        abs(each / 10 - round(each / 10)) < 1e-7 for each in s.tolist()
    )


def test_the_nearest_point_of_shapely_has_the_same_distance_beside_a_segment() -> None:
    shapely = pytest.importorskip("shapely")
    rng = np.random.default_rng(0)
    s, d = rng.uniform(0, ARC.length, 300), rng.uniform(-12, 12, 300)
    places, line = ARC.place(s, d), shapely.LineString(ARC.xy)
    off = shapely.distance(line, shapely.points(places))
    assert off == pytest.approx(np.abs(ARC.project(places).d), abs=2e-3)
    along = shapely.line_locate_point(line, shapely.points(places))
    assert np.abs(along - ARC.project(places).s).max() < 0.2, "a mitred corner moves s"


def test_a_parallel_line_counts_the_metres_driven_there() -> None:
    lane = ARC.parallel(3.5)
    s = np.linspace(10, 140, 50)
    found = lane.project(ARC.place(s, 3.5))
    assert found.d == pytest.approx(0, abs=1e-9)
    driven = np.hypot(*np.diff(ARC.place(s, 3.5), axis=0).T)
    assert np.diff(found.s) == pytest.approx(driven, rel=1e-4)
    assert ARC.scale(50.0, 3.5) == pytest.approx(1 - 3.5 / 100, abs=1e-4)
    assert np.diff(found.s)[0] == pytest.approx(np.diff(s)[0] * ARC.scale(20.0, 3.5), rel=1e-3)
    with pytest.raises(TrajectoryError, match="reach of 20 m"):
        ARC.parallel(20.0)


def test_a_straight_line_is_exact() -> None:
    line = RoadLine([(0, 0), (1, 0)])
    at = [-5.3, 0.3, 77.7]
    assert line.place(at, 3.5).tolist() == [[x, 3.5] for x in at]
    found = line.project([(x, 3.5) for x in at])
    assert found.s.tolist() == at and found.d.tolist() == [3.5] * 3
    assert line.pose(77.7, -1.1) == (77.7, -1.1, 0.0) and line.scale(0.5, 9.0) == 1.0


def test_a_place_beyond_the_reach_has_no_position() -> None:
    found = ARC.project([(0.0, 20.5), (0.0, 19.5)])
    assert found.d.tolist() == [math.inf, pytest.approx(19.5)] and np.isnan(found.s[0])


def test_where_the_road_comes_back_to_itself_a_place_is_ambiguous() -> None:
    around = np.linspace(0, 1.9 * math.pi, 100)
    ring = RoadLine(50 * np.stack([np.sin(around), 1 - np.cos(around)], axis=1), 10.0)
    found = ring.project([(-8.0, 5.0), (50.0, 50.0)])
    assert np.isnan(found.d[0]) and np.isnan(found.s[0])
    assert found.d[1] == pytest.approx(0, abs=0.1)


def test_many_places_are_projected_in_chunks() -> None:
    s = np.linspace(0, ARC.length, 2 * CHUNK + 7)
    assert ARC.project(ARC.place(s, -2.0)).s == pytest.approx(s, abs=1e-7)
    assert len(ARC.project(np.zeros((0, 2))).s) == 0


def test_the_zone_is_the_lane() -> None:
    zone = ARC.zone(1.75, 5.25, 10.0, 60.0)
    found = ARC.project(zone)
    assert found.s.min() == pytest.approx(10) and found.s.max() == pytest.approx(60)
    assert set(found.d.round(6)) == {1.75, 5.25}
    assert RoadLine([(0, 0), (1, 0)]).zone(-1, 1, -5, -2).tolist() == [
        *([-5, -1], [-2, -1], [-2, 1], [-5, 1])
    ]


@pytest.mark.parametrize(
    ("xy", "said"),
    [
        ([(0, 0)], "at least 2"),
        ([(0, 0), (1, 0), (1, 0)], r"xy\[2\]: repeats"),
        ([(0, 0), (10, 0), (10, 10), (20, 10)], r"xy\[0\]: the road bends too sharply"),
        ([(0, 0), (10, 0), (0, 0)], "too sharply"),
    ],
)
def test_what_is_no_line(xy: list[tuple[float, float]], said: str) -> None:
    with pytest.raises(TrajectoryError, match=said):
        RoadLine(xy)
