"""The lane change on the unchanged service."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from road_stage import answers_of, driven, lane_changers, rows, said

from automcm.applications.lane_change import LaneChange, Plan
from automcm.applications.planning import direction, gained_at, read
from automcm.applications.vehicle import LANE_WIDTH, Vehicle
from automcm.kernels.prescribe import prescribe
from automcm.kernels.trajectory import TrajectoryError, from_message
from automcm.kernels.verify import Limits
from automcm.links.simulated_radio import Channel
from automcm.service.application import Advertised, Proposal
from automcm_simulation.road.drive import FourVehicles, SimulatedDrive
from automcm_simulation.road.road import Sample
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.explain.explain import verdicts_of


def slowest(drive: SimulatedDrive, station_id: int) -> Sample:
    return min(drive.road.of(station_id), key=lambda sample: sample.speed)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("speed_kmh", [30, 50])
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_kin_4_the_four_vehicles_of_fig_6(speed_kmh: float, loss: float, tmp_path: Path) -> None:
    """B is prescribed, not A or C; it slows down before the lane change, and C follows it."""
    setting = FourVehicles(speed_kmh=speed_kmh)
    drive = setting.run(channel=Channel(loss=loss), logs=tmp_path)
    prescriber, a, b, c = lane_changers(drive)
    assert "prescribes 3 to drive 20 km/h slower" in said(prescriber)
    assert "has changed lanes" in said(prescriber)
    assert said(b)[:2] == ["accepts to drive slower", "loads the trajectory"]
    assert said(b)[-1] == "is done"
    assert said(a) == said(c) == ["drives alone: not_selected"]
    begins = next(t for t, what in prescriber.story if what == "moves over") / 1000
    before = next(s for s in drive.road.of(3) if s.t >= begins - 0.1)
    assert before.speed < speed_kmh / 3.6 - 5
    assert slowest(drive, 3).t <= begins + 0.2
    assert slowest(drive, 3).t < slowest(drive, 4).t and slowest(drive, 4).speed < speed_kmh / 4.5
    assert slowest(drive, 2).speed == pytest.approx(speed_kmh / 3.6)
    in_order = sorted(drive.road.vehicles, key=lambda v: -v.x)
    assert [v.station_id for v in in_order] == [2, 1, 3, 4]
    assert all(v.y == LANE_WIDTH for v in drive.road.vehicles)
    assert {v.verdict for v in verdicts_of(sorted(tmp_path.iterdir()))} == {"allowed"}


def test_pre_3_with_nobody_in_the_way_it_goes_at_once() -> None:
    drive = FourVehicles(vehicles=2, beside_m=60, until_s=15).run()
    prescriber, b = lane_changers(drive)
    assert "nobody is in the way" in said(prescriber) and "has changed lanes" in said(prescriber)
    assert said(b) == ["drives alone: not_needed"]


def test_pre_1_nobody_answers_is_no_free_lane() -> None:
    driver = LaneChange(Vehicle(1, 0, 0, 8, 8))
    driven(lambda: driver.signal(1), driver, until=10)
    assert said(driver)[-1] == "drives alone: no_participants" and driver.vehicle.lane == 0


def two(
    limits: Limits | None = None, *, cut_ms: int = 60_000, until: float = 30, **more: float
) -> tuple[LaneChange, LaneChange]:
    """A prescriber that signals after a second and a receiver, driven; from ``cut_ms`` on neither
    hears the other."""
    prescriber = LaneChange(Vehicle(1, 0, 0, 8.33, 8.33), Plan(**more))
    receiver = LaneChange(Vehicle(3, -3, 1, 8.33, 8.33), limits=limits)
    drive = SimulatedDrive([prescriber, receiver])
    drive.simulation.clock.at(1000, lambda: prescriber.signal(1))
    drive.simulation.clock.at(cut_ms, lambda: drive.simulation.radio.partition([1], [3]))
    drive.run(until)
    return prescriber, receiver


def test_adv_1_a_second_signal_changes_nothing() -> None:
    driver = LaneChange(Vehicle(1, 0, 0, 8, 8))
    given = answers_of(driver)
    for lane in (1, 2, 1):
        driver.signal(lane)
    assert (given, driver.wanted) == (["request"], 1)


def test_kin_4_the_direction_is_that_of_the_first_step() -> None:
    found = direction(from_message(rows((0, 900, 500), (1000, 1200, 900))))
    assert found == pytest.approx((0.6, 0.8))


def test_neg_7_three_refusals_and_it_stays() -> None:
    prescriber, receiver = two(Limits(acceleration=0.1, deceleration=0.1))
    assert sum("refuses" in what for what in said(receiver)) == 3
    assert said(prescriber)[-1] == "drives alone: no_agreement" and prescriber.vehicle.lane == 0


def test_neg_7_a_refusal_leads_to_a_gentler_proposal() -> None:
    prescriber, receiver = two(Limits(acceleration=2.2, deceleration=2.2))
    slower = [w for w in said(prescriber) if "prescribes" in w]
    assert slower == [f"prescribes 3 to drive {kmh} km/h slower" for kmh in (20, 14)]
    assert said(receiver)[:2] == ["refuses: acceleration", "accepts to drive slower"]


def test_act_1_act_2_a_target_that_falls_silent_leads_both_to_drive_alone() -> None:
    prescriber, receiver = two(cut_ms=5000)
    assert receiver.vehicle._profile is None and "moves over" not in said(prescriber)
    assert said(prescriber)[-1] == said(receiver)[-1] == "drives alone: cam_loss"
    assert prescriber.vehicle.lane == 0 and receiver.vehicle.speed == pytest.approx(8.33, abs=0.1)


def test_end_1_what_is_begun_is_ended_by_the_planner_on_board() -> None:
    prescriber, _ = two(cut_ms=9500)
    assert said(prescriber)[-3:] == ["moves over", "drives alone: cam_loss", "has changed lanes"]
    assert prescriber.vehicle.lane == 1 and not prescriber.vehicle.changing


class Odd(LaneChange):
    """A receiver whose Intention is ``sends``."""

    sends: messages.Trajectory

    def concerned(self, advertised: Advertised) -> messages.Trajectory | None:
        return self.sends


def answered_by(sends: messages.Trajectory, until: float) -> tuple[LaneChange, Odd]:
    """A prescriber, and the receiver that sends this Intention, driven."""
    prescriber, receiver = LaneChange(Vehicle(1, 0, 0, 8, 8)), Odd(Vehicle(3, -3, 1, 8, 8))
    receiver.sends = sends
    driven(lambda: prescriber.signal(1), prescriber, receiver, until=until)
    return prescriber, receiver


@pytest.mark.parametrize(
    "sends",
    [
        rows((0, -3000, 3500), t0=1000),
        rows((0, -3000, 3500), (1000, 5000, 3500)),
        rows((0, -3000, 3500), (60_000, 500_000, 3500), t0=3_600_000),
    ],
    ids=["one point", "a second", "another clock"],
)
def test_kin_3_where_nothing_is_known_the_lane_is_not_free(sends: messages.Trajectory) -> None:
    prescriber, _ = answered_by(sends, 30)
    assert "moves over" not in said(prescriber) and prescriber.vehicle.lane == 0
    assert "would come too close to [3]" in said(prescriber)


@pytest.mark.parametrize("sends", [rows((0, 0, 3500), (0, 1, 3500)), rows((5, 0, 0), (1, 9, 0))])
def test_end_5_an_intention_that_is_no_trajectory_crashes_nothing(
    sends: messages.Trajectory,
) -> None:
    prescriber, receiver = answered_by(sends, 8)
    assert "gives up: Intention of 3" in " ".join(said(prescriber))
    assert said(receiver)[-1] == "drives alone: abort" and prescriber.wanted is None


def test_mem_1_a_trajectory_of_too_many_points_is_not_read() -> None:
    with pytest.raises(TrajectoryError, match="Intention of 3: more than 500 points"):
        read("Intention of 3", rows(*((n, n, 0) for n in range(501))))


def test_kin_5_it_waits_for_the_gap_however_uneven_the_plan_is() -> None:
    fast_then_slow = [(0, -3000, 3500), (4000, 45_000, 3500), (60_000, 213_000, 3500)]
    theirs, plan = from_message(rows(*fast_then_slow, t0=1000)).since(3.1), Plan()
    wanted = prescribe(
        theirs, 3.1, hold=plan.hold_s, delta_v=plan.delta_v, gain=plan.gain_m, v_min=plan.v_min
    )
    end = gained_at(theirs, wanted, plan.gain_m)
    behind = np.interp(end, theirs.t, theirs.arc()) - np.interp(end, wanted.t, wanted.arc())
    assert behind == pytest.approx(plan.gain_m, abs=0.01)
    assert end > 3.1 + plan.hold_s + plan.gain_m / plan.delta_v + 1


def test_end_7_after_a_refused_request_it_may_ask_again() -> None:
    driver = LaneChange(Vehicle(1, 0, 0, 8, 8))
    drive = SimulatedDrive(
        [driver], parameters=Parameters(t_timeout=0, backoff_min=900, backoff_max=900)
    )
    for t in (100, 500, 3000):  # the second within the back-off
        drive.simulation.clock.at(t, lambda: driver.signal(1))
    drive.run(5)
    assert [w for w in said(driver) if "refused" in w] == ["request is refused by END-7"]
    assert said(driver).count("signals for lane 1") == 3


@pytest.mark.parametrize("speed_kmh", [30, 80, 120])
@pytest.mark.sweep(2)
@pytest.mark.parametrize("seed", range(4))
def test_neg_2_a_prescription_that_was_long_on_its_way_is_anchored_where_it_is_accepted(
    speed_kmh: float, seed: int
) -> None:
    drive = FourVehicles(vehicles=2, speed_kmh=speed_kmh, seed=seed, until_s=25).run(
        channel=Channel(loss=0.3)
    )
    prescriber, receiver = lane_changers(drive)
    assert "accepts to drive slower" in said(receiver)
    assert not any("path" in what for what in said(receiver))
    assert prescriber.vehicle.lane == 1


class Commands:
    """A service that keeps its commands."""

    def __init__(self) -> None:
        self.given: list[Any] = []

    def now(self) -> int:
        return 0

    def command(self, command: Any, after_ms: int = 0) -> None:
        self.given.append(command)


def test_neg_3_who_changes_lanes_itself_refuses_a_prescription() -> None:
    for changing in (False, True):
        receiver, service = LaneChange(Vehicle(3, 0.0, 1, 20.0, 20.0)), Commands()
        receiver.attach(service)
        planned = receiver.concerned(Advertised((1, 1), "lane_change", {"lane": 1}, None))
        assert planned is not None
        if changing:
            receiver.vehicle.change_lane(0, 0.0)
        receiver.verify(Proposal((1, 1), 1, planned, 0, 10_000))
        assert [command.name for command in service.given] == ["refuse" if changing else "accept"]


@pytest.mark.parametrize("lane", [True, 1.0, "1"])
def test_a_lane_is_an_integer(lane: object) -> None:
    driver = LaneChange(Vehicle(1, 0, 1, 8, 8))
    SimulatedDrive([driver])
    details: dict[str, Any] = {"lane": lane}
    assert driver.concerned(Advertised((2, 1), "lane_change", details, None)) is None
    assert driver.concerned(Advertised((2, 1), "lane_change", {"lane": 1}, None)) is not None


LANELETS = """<osm version="0.6">
  <node id="1" lat="49.0" lon="8.9990"/><node id="2" lat="49.0" lon="9.0050"/>
  <node id="3" lat="49.000031475" lon="8.9990"/><node id="4" lat="49.000031475" lon="9.0050"/>
  <node id="5" lat="49.0" lon="9.0060"/><node id="6" lat="49.000031475" lon="9.0060"/>
  <way id="12"><nd ref="2"/><nd ref="5"/></way><way id="13"><nd ref="4"/><nd ref="6"/></way>
  <way id="10"><nd ref="1"/><nd ref="2"/></way>
  <way id="11"><nd ref="3"/><nd ref="4"/></way>
  <relation id="1"><member type="way" ref="11" role="left"/>
    <member type="way" ref="10" role="right"/><tag k="type" v="lanelet"/></relation>
  <relation id="2"><member type="way" ref="13" role="left"/>
    <member type="way" ref="12" role="right"/><tag k="type" v="lanelet"/></relation>
</osm>
"""


def test_kin_4_the_lane_may_come_from_a_map(tmp_path: Path) -> None:
    pytest.importorskip("lanelet2", reason="extra automcm[map]: not for this machine")
    from automcm_simulation.road.lanelet_map import LaneMap, MapError

    path = tmp_path / "road.osm"
    path.write_text(LANELETS)
    # The origin is half a lane above the road's, so that the lanelet is lane 1.
    lanes = LaneMap(path, (49.0 - 1.75 / 111_194, 9.0))
    zone = lanes.zone(1)
    assert zone.shape == (4, 2) and zone[:, 1].min() == pytest.approx(1.75, abs=0.2)
    assert zone[:, 1].max() == pytest.approx(5.25, abs=0.2)
    prescriber = LaneChange(Vehicle(1, 0, 0, 8.33, 8.33), zone=lanes.zone)
    receiver = LaneChange(Vehicle(3, -3, 1, 8.33, 8.33))
    driven(lambda: prescriber.signal(1), prescriber, receiver)
    assert "prescribes 3 to drive 20 km/h slower" in said(prescriber)
    line, longer = lanes.line([1]), lanes.line([1, 2])
    ahead = line.project(np.array([[3.0, 4.5]]))
    assert ahead.d[0] == pytest.approx(1.0, abs=0.2) and abs(ahead.heading[0]) < 0.05
    assert line.length == pytest.approx(np.ptp(zone[:, 0]), abs=0.5)
    assert longer.length == pytest.approx(line.length * 7 / 6, abs=0.5)
    with pytest.raises(MapError, match="lane 7"):
        lanes.zone(7)
    for wrong in ([1, 7], []):
        with pytest.raises(MapError, match="lanes"):
            lanes.line(wrong)
    with pytest.raises(MapError, match="nowhere"):
        LaneMap(tmp_path / "nowhere", (49.0, 9.0))


MEMBER = '<member type="relation" ref="8" role="regulatory_element"/>'
UNUSED = """<way id="14"><nd ref="99"/></way>
  <relation id="8"><member type="way" ref="14" role="refers"/>
    <tag k="type" v="regulatory_element"/><tag k="subtype" v="detection_area"/></relation>
  <relation id="9"><tag k="type" v="multipolygon"/></relation></osm>"""


@pytest.mark.parametrize(
    ("was", "now", "problem"),
    [
        ('<tag k="type" v="lanelet"/>', f'{MEMBER}<tag k="type" v="lanelet"/>', ""),
        ('lat="49.0" lon="', 'north="', r"node 1: has no lat and lon; .* \(and 2 more\)"),
        ('lon="8', 'lon="800', r"Error parsing primitive 1: Longitude .* \(and \d+ more\)"),
        ("</osm>", "", "no element found"),
    ],
)
def test_a_map_is_read_despite_what_is_no_lane_or_one_line_says_why_not(
    was: str, now: str, problem: str, tmp_path: Path
) -> None:
    pytest.importorskip("lanelet2", reason="extra automcm[map]: not for this machine")
    from automcm_simulation.road.lanelet_map import LaneMap, MapError

    path = tmp_path / "road.osm"
    path.write_text(LANELETS.replace("</osm>", UNUSED).replace(was, now))
    if not problem:
        assert LaneMap(path, (49.0, 9.0)).lanes() == [1, 2]
        return
    with pytest.raises(MapError, match=f"road.osm: {problem}") as caught:
        LaneMap(path, (49.0, 9.0))
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(("name", "value"), [("vehicles", 5), ("speed_kmh", 0)])
def test_a_setting_that_cannot_be_is_refused_by_name(name: str, value: int) -> None:
    with pytest.raises(ValueError, match=name):
        FourVehicles(**{name: value})
