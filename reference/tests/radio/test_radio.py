"""``TableRadio``: its rules, its repetition by seed, and its fit to the measurements of ns-3."""

from __future__ import annotations

import math

import numpy as np
import pytest

from automcm_evaluation.radio import radio_tables, radio_traffic
from automcm_simulation.radio import propagation
from automcm_simulation.radio.propagation import OfferedLoad, Propagation, path_loss_db
from automcm_simulation.radio.radio import LARGEST_BYTES, Arrival
from automcm_simulation.radio.table_radio import TableRadio, committed

NEAR = {1: (0.0, 0.0), 2: (25.0, 0.0), 3: (5000.0, 0.0)}
MEASURED = {m.traffic.name: m for m in radio_traffic.ns3_measured()}
QUICK = "25 per km"
FITTED = [m.traffic.name for m in MEASURED.values() if m.traffic.fitted]
OTHERS = {"75 per km": 3.0, "120 per km, 400 bytes": 5.0, "two jams": 3.0}
"""Traffics that the table was not fitted to, and the largest difference in what arrives, points."""


def received(seed: int, background: float = 0.0) -> list[Arrival]:
    radio = TableRadio(seed, background=background)
    found = []
    for step in range(20):
        radio.move({1: (step * 5.0, 0.0), 2: (350.0, 0.0), 3: (step * 2.0, 300.0)})
        for sender in (3, 1):
            radio.transmit(sender, 150, step * 100, step * 10 + sender)
        found += radio.advance(step * 100 + 99)
    return found


def test_equal_seeds_give_equal_receptions_and_others_do_not() -> None:
    assert received(1) == received(1) != received(2)
    assert received(1) == sorted(received(1)) and len(received(1)) > 20


def test_a_near_station_receives_and_a_far_one_and_the_sender_do_not() -> None:
    radio = TableRadio(1)
    radio.move(NEAR)
    for frame in range(100):
        radio.transmit(1, 150, 0, frame)
    found = radio.advance(50)
    assert all(a.receivers == [2] for a in found) and len(found) > 95
    assert min(a.at_ms for a in found) >= 1 and radio.advance(5000) == []


def test_what_is_due_later_comes_later() -> None:
    radio = TableRadio(1)
    radio.move(NEAR)
    radio.transmit(1, 2000, 10, 7)
    assert radio.advance(11) == []  # 2.9 ms of airtime
    assert radio.advance(30) == [Arrival(13, 7, [2])]


def test_bad_calls_are_refused() -> None:
    radio = TableRadio(1)
    radio.move(NEAR)
    radio.advance(10)
    with pytest.raises(ValueError, match="station 9 has no position: call move first"):
        radio.transmit(9, 150, 10, 1)
    for size in (0, LARGEST_BYTES + 1):
        with pytest.raises(ValueError, match=f"size_bytes must be from 1 to .*, not {size}"):
            radio.transmit(1, size, 10, 1)
    with pytest.raises(ValueError, match="now_ms must be at least 10, not 9"):
        radio.transmit(1, 150, 9, 1)
    with pytest.raises(ValueError, match="until_ms must be at least 10, not 9"):
        radio.advance(9)
    for bad in (math.nan, math.inf):
        with pytest.raises(ValueError, match="the position of station 2 must be finite"):
            radio.move({1: (0.0, 0.0), 2: (0.0, bad)})
    for load in (-0.1, math.inf, math.nan):
        with pytest.raises(ValueError, match="background must be a finite share"):
            TableRadio(1, background=load)


def test_the_loss_grows_with_the_distance_without_a_step() -> None:
    distance = np.linspace(0, 1000, 4001)
    steps = np.diff(path_loss_db(distance))
    assert steps.min() >= 0 and steps[distance[1:] > 10].max() < 0.3


def test_shadowing_has_its_deviation_and_fades_with_the_way() -> None:
    def shadows(way: float) -> tuple[np.ndarray, np.ndarray]:
        medium = Propagation(3)
        places = {i: (200.0 + i, 0.0) for i in range(1, 60)}
        medium.move(places)
        before = medium._shadow[np.triu_indices(59, 1)]
        medium.move({i: (x + way, y) for i, (x, y) in places.items()})
        assert (medium._shadow == medium._shadow.T).all()
        return before, medium._shadow[np.triu_indices(59, 1)]

    for way in (0.0, 5.0, 25.0, 500.0):
        before, after = shadows(way)
        assert after.std() == pytest.approx(propagation.SHADOW_DB, rel=0.05)
        kept = math.exp(-way / propagation.SHADOW_M)
        assert np.corrcoef(before, after)[0, 1] == pytest.approx(kept, abs=0.05)


def test_a_new_station_in_an_old_slot_has_its_own_shadowing() -> None:
    medium = Propagation(3)
    medium.move({1: (0.0, 0.0), 2: (100.0, 0.0)})
    before = medium.mean_dbm[0, 1]
    medium.move({1: (0.0, 0.0), 2: (100.0, 0.0)})
    assert medium.mean_dbm[0, 1] == before
    medium.move({1: (0.0, 0.0), 3: (100.0, 0.0)})
    assert medium.slots == {1: 0, 3: 1} and abs(medium.mean_dbm[0, 1] - before) > 0.01


def test_the_offered_load_is_the_airtime_of_the_last_second() -> None:
    load, power = OfferedLoad(), np.array([-1000.0, -60.0, -100.0])
    load.enter([0, 1, 2], 3)
    for ms in range(0, 1500, 10):
        load.advance(ms)
        load.add(0, power, 400.0)
    assert load.share == pytest.approx([0.04, 0.04, 0.0])
    assert not load.advance(1499) and load.advance(2000)
    assert load.share == pytest.approx([0.02, 0.02, 0.0])
    load.advance(2500)
    assert load.share.max() == 0.0
    load.add(0, power, 400.0)
    load.advance(9000)
    assert load.share.max() == 0.0


def test_load_makes_the_channel_busy_and_loses_frames() -> None:
    busy, share = [], []
    for background in (0.0, 0.3, 0.6):
        radio = TableRadio(1, background=background)
        radio.move({1: (0.0, 0.0), 2: (200.0, 0.0)})
        busy.append(radio.channel_busy_ratio(1))
        share.append(np.mean([len(received(seed, background)) for seed in range(20)]))
    assert busy == sorted(set(busy)) and share == sorted(set(share), reverse=True)


def fits(ns3: radio_traffic.Measured, table: radio_traffic.Measured) -> dict[str, float | None]:
    arrived = radio_tables.arrivals(ns3, table.rows)
    bands = radio_tables.bursts(ns3, table.rows)
    return {
        "arrived": radio_tables.largest([(row["ns3"], row["table"]) for row in arrived]),
        "again": radio_tables.largest([band["again"] for band in bands]),
        "long": radio_tables.largest([band["long"] for band in bands]),
    }


def over_table(traffic: radio_traffic.FourLanes, seeds: int = 1) -> radio_traffic.Measured:
    parts = [radio_traffic.measured(TableRadio(traffic.seed + n), traffic) for n in range(seeds)]
    return radio_traffic.pooled(parts)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n == QUICK else pytest.mark.slow) for n in FITTED]
)
def test_the_table_is_within_3_points_of_ns_3_at_every_distance(name: str) -> None:
    ns3 = MEASURED[name]
    found = fits(ns3, over_table(ns3.traffic, 1 if name == QUICK else 2))
    compared = [apart for apart in found.values() if apart is not None]
    assert max(compared) <= radio_tables.POINTS, found


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_the_table_is_near_ns_3_where_it_was_not_fitted(name: str) -> None:
    arrived = fits(MEASURED[name], over_table(MEASURED[name].traffic, 2))["arrived"]
    assert arrived is not None and arrived <= OTHERS[name]


def test_arrivals_fall_with_load_and_distance_in_the_table() -> None:
    shares = np.array(committed().delivery)
    assert shares.shape == (2, len(committed().load), len(committed().power_dbm))
    assert shares.min() >= 0 and shares.max() <= 1
    assert (np.diff(shares, axis=2) >= 0).all() and (np.diff(shares, axis=1) <= 0.01).all()


def test_vehicles_stay_on_the_road_and_keep_their_lane() -> None:
    traffic = radio_traffic.FourLanes(name="", per_km=20, seconds=1)
    for _, places in zip(range(200), radio_traffic.positions(traffic), strict=False):
        assert all(0 <= x < traffic.road_m for x, _ in places.values())
    assert len(places) == traffic.vehicles == 24
