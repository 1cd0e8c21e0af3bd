"""A Lanelet2 map as the road of traffic: what SUMO is told, and where its ways cross."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("lanelet2", reason="extra automcm[map]: not for this machine")

from automcm_simulation.traffic import lanelet_network
from automcm_simulation.traffic.mover import TrafficError
from automcm_simulation.traffic.sumo_mover import NETWORKS
from automcm_simulation.traffic_scenarios.intersection_traffic import LaneletIntersection

TOWN = NETWORKS / "town.osm"


def told(path: Path, folder: Path, ending: str) -> list[dict[str, str]]:
    lanelet_network.write(path, folder)
    return [
        dict(e.attrib) for e in ElementTree.parse(folder / f"{path.stem}.{ending}.xml").getroot()
    ]


def points(shape: str) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in (place.split(",") for place in shape.split())]


def test_lanes_become_edges_and_what_turns_a_junction(tmp_path: Path) -> None:
    edges = {edge["id"]: edge for edge in told(TOWN, tmp_path, "edg")}
    assert list(edges) == ["10", "12", "20", "22", "31"]
    assert {e["speed"] for e in edges.values()} == {"13.889"}
    over = {(c["from"], c["to"]) for c in told(TOWN, tmp_path, "con")}
    assert over == {("10", "12"), ("10", "31"), ("20", "22"), ("20", "31")}
    nodes = {node["id"]: node for node in told(TOWN, tmp_path, "nod")}
    [middle] = {edges["10"]["to"], edges["20"]["to"]}
    assert {edges[road]["from"] for road in ("12", "22", "31")} == {middle}
    assert nodes.pop(middle)["type"] == "priority"
    assert {node["type"] for node in nodes.values()} == {"dead_end"} and len(nodes) == 5


def test_a_way_over_the_junction_has_no_gap(tmp_path: Path) -> None:
    edges = {edge["id"]: points(edge["shape"]) for edge in told(TOWN, tmp_path, "edg")}
    for turn in told(TOWN, tmp_path, "con"):
        shape = points(turn["shape"])
        assert shape[0] == edges[turn["from"]][-1] and shape[-1] == edges[turn["to"]][0]


def test_the_ways_cross_on_both_of_them() -> None:
    place, oncoming = LaneletIntersection().ways()
    lanes = lanelet_network.lane_map(TOWN)
    for line in (oncoming, lanes.line([30], reach=1.0)):
        found = line.project(np.array([place]))
        assert abs(float(found.d[0])) < 0.05 and 0 < float(found.s[0]) < line.length


@pytest.mark.parametrize("tag", ["", '<tag k="speed_limit" v="fast" />'])
def test_a_road_needs_a_speed_limit(tag: str, tmp_path: Path) -> None:
    path = tmp_path / "town.osm"
    path.write_text(TOWN.read_text().replace('<tag k="speed_limit" v="50" />', tag))
    with pytest.raises(TrafficError, match=r"town\.osm: lane 10 has no speed_limit, km/h"):
        lanelet_network.write(path, tmp_path)


def test_a_turn_that_leads_nowhere_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "town.osm"
    head, lane, rest = TOWN.read_text().partition('<relation id="31"')
    turns = '<tag k="turn_direction" v="left" /></relation>'
    path.write_text(head + lane + rest.replace("</relation>", turns, 1))
    with pytest.raises(TrafficError, match=r"the lanelets \[31\] connect no others"):
        lanelet_network.write(path, tmp_path)


def test_a_file_that_is_no_map_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "town.osm").write_text("<osm")
    with pytest.raises(TrafficError, match=r"town\.osm"):
        lanelet_network.write(tmp_path / "town.osm", tmp_path)
