"""Hazards on the road: the room that is left, the time to collision, and who brakes."""

from __future__ import annotations

import pytest

from automcm.applications.vehicle import LateBraking, Vehicle
from automcm_evaluation.safety import safety, safety_road
from automcm_evaluation.safety.ablations import WHOLE
from automcm_evaluation.safety.faults import Injected
from automcm_simulation.road.road import Sample

# -- the road


def samples(*vehicles: tuple[int, list[tuple[float, float, float]]]) -> list[Sample]:
    return [
        Sample(0.1 * n, station_id, x, y, v, 0.0)
        for station_id, rows in vehicles
        for n, (x, y, v) in enumerate(rows)
    ]


def test_room_gap_and_time_to_collision() -> None:
    mover = Vehicle(1, 0, 0, 8, 8)
    own = [(0.0, 0.0, 8.0), (10.0, 0.0, 8.0), (20.0, 1.0, 8.0), (30.0, 2.0, 8.0), (40.0, 3.5, 8.0)]
    behind = [(-20.0, 3.5, 9.0), (0.0, 3.5, 9.0), (15.0, 3.5, 9.0), (24.0, 3.5, 9.0)]
    found = safety_road.nearest(samples((1, own), (3, [*behind, (34.0, 3.5, 10.0)])), mover)
    assert found == pytest.approx((5.5, 1.5, 0.75))
    assert safety_road.nearest(samples((1, own[:2]), (3, behind[:2])), mover) == (None, None, None)
    ahead = [(x + 9, 3.5, 12.0) for x, *_ in own]
    assert safety_road.nearest(samples((1, own), (2, ahead)), mover)[1:] == (4.5, None)


def test_on_the_road_the_target_lets_go_and_room_is_what_tells() -> None:
    values = {"part": "road", "ablation": WHOLE.name, "speed_kmh": 30, "delay_ms": 40}
    values |= {"begins": "maneuver", "first": 0, "drives": 2}
    coordinated = safety.run(values, 3)
    alone = safety.run(values | {"ablation": safety_road.UNCOORDINATED}, 3)
    assert coordinated["bound_ms"] == 1540 and coordinated["wrong"] == []
    assert all(room is None or room > 8 for room in coordinated["room_m"])
    assert all(room < 0.5 for room in alone["room_m"]) and alone["lengths"] == {}
    assert alone["with_hazard"] == 0
    assert min(alone["braking"]) > 4 > max(coordinated["braking"])
    assert alone["unasked"] == 2 and coordinated["unasked"] == 0


def on_the_road(
    monkeypatch: pytest.MonkeyPatch, fault: Injected, name: str
) -> safety_road.SafetyDrive:
    monkeypatch.setattr(safety_road, "drawn", lambda *more: [fault])
    values = {"part": "road", "ablation": name, "speed_kmh": 50, "begins": "maneuver"}
    return safety_road.drive(values | {"delay_ms": 40}, 1)


def test_who_is_told_in_time_does_not_move_over(monkeypatch: pytest.MonkeyPatch) -> None:
    early = on_the_road(monkeypatch, Injected("target restarts", 4000, 0), WHOLE.name)
    assert early.room_m is None and not early.begun and len(early.hazards) == 1
    late = on_the_road(monkeypatch, Injected("target restarts", 8000, 0), WHOLE.name)
    assert late.begun and late.room_m is not None and not late.unasked
    over = on_the_road(monkeypatch, Injected("target restarts", 12_500, 0), WHOLE.name)
    assert over.begun and over.room_m is not None
    plain = on_the_road(monkeypatch, Injected("target restarts", 4000, 0), "plain CAMs count")
    assert plain.begun and plain.room_m is not None and plain.room_m < 8
    assert plain.braking > 4 > over.braking
    crash = Injected("target crashes", 4000, 20_000)
    alone = on_the_road(monkeypatch, crash, "no CAM-loss fallback")
    assert alone.room_m is not None and alone.room_m < 8, "who has crashed drives on alone"
    never = on_the_road(monkeypatch, Injected("cut back", 20_000, 21_000), WHOLE.name)
    assert not never.begun and never.room_m is not None and never.hazards == []


def test_only_who_is_not_committed_notices_late(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(safety_road, "LateBraking", lambda: LateBraking(range_m=30.0))
    nothing = Injected("cut back", 20_000, 21_000)
    assert on_the_road(monkeypatch, nothing, WHOLE.name).braking < LateBraking().brake
    assert on_the_road(monkeypatch, nothing, safety_road.UNCOORDINATED).braking > 4


def test_a_fault_may_begin_with_the_first_advertisement(monkeypatch: pytest.MonkeyPatch) -> None:
    """B's answer is lost: who counts answers moves over beside it (APP-2)."""
    times: list[tuple[int, int]] = []
    monkeypatch.setattr(
        safety_road, "drawn", lambda kinds, window, draw: times.append(window) or []
    )
    values = {"part": "road", "ablation": WHOLE.name, "speed_kmh": 30, "delay_ms": 40}
    for begins in safety_road.WINDOWS_MS:
        safety_road.drive(values | {"begins": begins}, 1)
    (first, agreed), (same, _) = times
    assert first == 1000 and agreed == same
    cut = Injected("cut back", first, 4000)
    counts, looks = (
        on_the_road(monkeypatch, cut, name) for name in (WHOLE.name, safety_road.LOOKS)
    )
    assert counts.unasked and counts.room_m is not None and counts.room_m < safety_road.NEAR_M
    assert looks.room_m is None
