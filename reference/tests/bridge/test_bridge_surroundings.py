"""What the service has heard reaches the application at the far end of the bridge (APP-1)."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest
from bridge_stage import BRIDGED, Operator
from hypothesis import given
from hypothesis import strategies as st
from road_stage import Records, car, said

from automcm.applications.lane_change import LaneChange
from automcm.bridge import rosbridge as ros
from automcm.bridge.websocket_bridge import WebSocketBridge
from automcm.service import application
from automcm.service.application import Choice, Heard, heard_by
from automcm.service.service import NEIGHBOURS, McService
from automcm_simulation.road.drive import STEP_MS, Driver, SimulatedDrive
from automcm_simulation.road.occupancy_sweep import CamOnly
from automcm_simulation.road.remote_application import RemoteApplication
from automcm_simulation.road.simulation import Simulation
from automcm_spec.vocabulary.messages import LIMIT

LATENCY_MS = 7


class Bridged(WebSocketBridge):
    """A driver at the far end of a bridge, in virtual time and without sockets."""

    connected = True

    def __init__(self, driver: Driver) -> None:
        super().__init__()
        self.driver, self.vehicle = driver, driver.vehicle
        self.tick = driver.tick

    def attach(self, service: application.Service) -> None:
        super().attach(service)
        assert isinstance(service, McService)
        self.near, self.clock = Operator(self), service._clock
        self.far = RemoteApplication(self.driver, clock=self.clock)
        self.far._clock = self.clock
        self.far._outbox = SimpleNamespace(put=self.to_bridge)  # type: ignore[assignment]
        self.driver.attach(self.far)
        self.near.client.outbox.put = self.to_driver  # type: ignore[method-assign]
        self._clients.add(self.near.client)
        for topic in ros.OUTPUTS:
            self.to_bridge(ros.operation(op="subscribe", topic=topic))
        self.publish()

    def publish(self) -> None:
        self.far._publish_present()
        self.clock.at(self.clock.now() + STEP_MS, self.publish)

    def to_bridge(self, text: str) -> None:
        self.clock.at(self.clock.now() + LATENCY_MS, lambda: self._take(self.near.client, text))

    def to_driver(self, text: str) -> None:
        if self.connected:
            self.clock.at(self.clock.now() + LATENCY_MS, lambda: self.far._take(text))


def bridged_drive(*others: Driver) -> tuple[Records, Bridged, SimulatedDrive]:
    prescriber = Records(car(1, 0, 0))
    bridge = Bridged(prescriber)
    drive = SimulatedDrive([bridge, *others])
    drive.simulation.clock.at(1000, lambda: prescriber.signal(1))
    return prescriber, bridge, drive


# -- a lane change over the bridge


def test_app_1_a_lane_change_over_the_bridge_completes() -> None:
    prescriber, _, drive = bridged_drive(target := LaneChange(car(3, -3)))
    drive.run(25)
    assert said(prescriber)[-1] == "has changed lanes" and said(target)[-1] == "is done"
    assert prescriber.vehicle.lane == 1
    assert [kind for _, station, kind in drive.sent if station == 1][-1] == "Fin"


def test_app_1_a_choice_over_the_bridge_is_that_without_it() -> None:
    prescriber, bridge, drive = bridged_drive(CamOnly(car(3, -3)), LaneChange(car(4, -90)))
    asked: list[Choice] = []
    choose = bridge.choose
    bridge.choose = lambda choice: (asked.append(choice), choose(choice))[1]  # type: ignore[method-assign]
    drive.run(25)
    assert [prescriber.asked] == asked and len(asked[0].heard or ()) == 2
    assert heard_by(prescriber.service) == bridge.far.heard() != ()


def test_app_4_over_the_bridge_it_does_not_move_over_when_the_bridge_is_silent() -> None:
    prescriber, bridge, drive = bridged_drive(LaneChange(car(3, -3)))
    clock = drive.simulation.clock

    def silent() -> None:
        bridge.connected = not any("is accepted" in words for words in said(prescriber))
        clock.at(clock.now() + STEP_MS, silent)

    silent()
    drive.run(25)
    assert bridge.far.heard() is None
    assert "moves over" not in said(prescriber) and prescriber.vehicle.lane == 0


# -- the message


def heard(**more: Any) -> Heard:
    return Heard(
        **{"station_id": 3, "received_ms": 5, "x_mm": 1, "y_mm": 2, "heading_mrad": 3}
        | {"speed_mm_s": 4}
        | more
    )


LENGTH = st.none() | st.integers(0, LIMIT)
INTEGER = st.integers(-LIMIT, LIMIT)
STATION = st.integers(1, 2**32 - 1)
HEARD = st.builds(
    Heard,
    station_id=STATION,
    received_ms=st.integers(0, 2**31 * 1000 - 1),
    x_mm=INTEGER,
    y_mm=INTEGER,
    heading_mrad=INTEGER,
    speed_mm_s=INTEGER,
    marks=st.lists(st.tuples(STATION, st.integers(1, LIMIT)), max_size=ros.MAX_NAMED).map(tuple),
    length_mm=LENGTH,
    width_mm=LENGTH,
    sigma_mm=LENGTH,
    in_step=st.booleans(),
)


@given(st.lists(HEARD, max_size=3))
def test_what_was_heard_comes_back_as_it_was(all_: list[Heard]) -> None:
    message = ros.SurroundingsMsg(heard=[ros.HeardMsg.of(each, None) for each in all_])
    again = ros.read(ros.SurroundingsMsg, json.loads(ros.publication(message))["msg"])
    assert [each.value() for each in again.heard] == all_


def test_of_many_marks_those_are_passed_on_that_decide() -> None:
    own, others = (1, 7), tuple((9, n) for n in range(1, 100))
    for marks in ((*others, own), others, (own,)):
        short = ros.HeardMsg.of(heard(marks=marks), own).value()
        assert len(short.marks) <= ros.MAX_NAMED
        assert (own in short.marks) == (own in marks)
        for session in (own, None, (2, 2)):
            assert short.bound_elsewhere(session) == heard(marks=marks).bound_elsewhere(session)


@pytest.mark.parametrize(
    "wrong",
    [
        {"station_id": 0},
        {"length_mm": -2},
        {"length_mm": None},
        {"speed_mm_s": 2**53},
        {"marks": [{"prescriber": 0, "number": 0}]},
        {"marks": [{"prescriber": 1, "number": 1}] * (ros.MAX_NAMED + 1)},
        {"in_step": 1},
    ],
)
def test_malformed_surroundings_change_nothing_and_are_answered(wrong: dict[str, Any]) -> None:
    _, bridge, drive = bridged_drive(LaneChange(car(3, -3)))
    drive.run(1)
    good = ros.HeardMsg.of(heard(), None).model_dump()
    before, statuses = bridge.far.heard(), list[str]()
    bridge.far._outbox = SimpleNamespace(put=statuses.append)  # type: ignore[assignment]
    for entries in ([good | wrong], [good] * (NEIGHBOURS + 1)):
        bridge.far._take(
            ros.operation(op="publish", topic=ros.SurroundingsMsg.topic, msg={"heard": entries})
        )
    assert len(statuses) == 2 and all('"level":"error"' in each for each in statuses)
    assert bridge.far.heard() == before and len(before or ()) == 1


def test_as_many_as_are_remembered_fit_a_message() -> None:
    far, marks = LIMIT, tuple((2**32 - 1, LIMIT - n) for n in range(255))
    most = heard(x_mm=-far, y_mm=-far, heading_mrad=-far, speed_mm_s=-far, marks=marks)
    message = ros.SurroundingsMsg(heard=[ros.HeardMsg.of(most, (1, 1))] * NEIGHBOURS)
    assert len(ros.publication(message)) < ros.MAX_OUT / 16


def test_before_the_first_message_nothing_is_known_of_the_surroundings() -> None:
    """An empty message, unlike none, says that nobody was heard."""
    simulation = Simulation()
    bridge = Bridged(LaneChange(car(BRIDGED, 0)))
    bridge.connected = False
    simulation.add(BRIDGED, bridge)
    simulation.run(1000)
    assert bridge.far.heard() is None
    bridge.connected = True
    simulation.clock.at(1000, lambda: None)
    simulation.run(1300)
    assert bridge.far.heard() == ()


def test_a_new_connection_forgets_the_surroundings_and_gets_them_at_once() -> None:
    """The router may have restarted, and its clock with it."""
    _, bridge, drive = bridged_drive(LaneChange(car(3, -3)))
    drive.run(1)
    texts = list[str]()
    bridge.near.client.outbox.put = texts.append  # type: ignore[method-assign]
    bridge.far.connected.clear()
    bridge.far._take(bridge._state())
    assert bridge.far.heard() is None
    topic = ros.SurroundingsMsg.topic
    bridge._take(bridge.near.client, ros.operation(op="subscribe", topic=topic))
    bridge.far._take(*texts)
    assert [each.station_id for each in bridge.far.heard() or ()] == [3]
