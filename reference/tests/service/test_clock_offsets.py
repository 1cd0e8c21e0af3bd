"""APP-6: a station whose clock is out of step counts as one that did not answer."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from automcm.encoding.codec import JSON
from automcm.links.simulated_radio import Channel
from automcm.links.udp_link import UdpLink
from automcm.service.application import Choice, Proposal
from automcm.service.clock_offsets import CAMS, Bounds, ClockOffsets, bounds, in_step
from automcm.service.service import McService
from automcm.service.station_process import StationProcess
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.parameters import Parameters

KNOWN = Parameters().known
DELAY_MS = 50


@given(
    offset=st.integers(-10_000, 10_000),
    ways=st.lists(st.integers(0, DELAY_MS), min_size=1, max_size=20),
    late=st.lists(st.integers(DELAY_MS + 1, 5000), max_size=5),
)
def test_app_6_the_bounds_hold_whatever_the_ways_and_however_many_are_late(
    offset: int, ways: list[int], late: list[int]
) -> None:
    cams, now = [], 0
    for way in [*ways, *late]:
        cams.append((now - way + offset, now))
        now += 50
    low, high = bounds(cams, now, DELAY_MS, 0)
    assert low <= offset
    if not late:
        assert high >= offset


@given(
    st.lists(
        st.tuples(
            st.integers(0, 900), st.sampled_from((-260, -151, -150, -90, 0, 99, 100, 101, 190))
        ),
        min_size=1,
        max_size=60,
    )
)
def test_app_6_each_cam_is_judged_as_the_bounds_of_all(cams: list[tuple[int, int]]) -> None:
    offsets = ClockOffsets(1, 4, KNOWN, lambda station_id, bounds: None)
    kept: list[tuple[int, int]] = []
    now = 0
    for later, off in cams:
        now += later
        kept = [*kept, (now + off, now)][-CAMS:]
        judged = in_step(bounds(kept, now, DELAY_MS, KNOWN["clock_drift"]))
        assert offsets.heard(2, now + off, now) is judged


@dataclass
class Asked(Straight):
    """Keeps what it was asked."""

    choices: list[Choice] = field(default_factory=list)
    proposals: list[Proposal] = field(default_factory=list)

    def choose(self, choice: Choice) -> None:
        self.choices.append(choice)
        super().choose(choice)

    def verify(self, proposal: Proposal) -> None:
        self.proposals.append(proposal)
        super().verify(proposal)


def three(offsets_ms: dict[int, int], until: int = 8000) -> tuple[Simulation, dict[int, Asked]]:
    """1 requests a session of 2 and 3."""
    simulation = Simulation(channel=Channel(delay_ms=(0, 40)))
    asked = {n: Asked() for n in (1, 2, 3)}
    for n, application in asked.items():
        simulation.add(n, application, offset_ms=offsets_ms.get(n, 0))
    simulation.request(1, 1000)
    simulation.run(until)
    return simulation, asked


@pytest.mark.parametrize("offset_ms", [200, 10_000])
def test_app_6_who_is_out_of_step_did_not_answer(
    offset_ms: int, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "automcm.service"):
        simulation, asked = three({2: offset_ms})
    (choice,) = asked[1].choices
    assert set(choice.planned) == {3} and choice.heard is not None
    assert {each.station_id: each.in_step for each in choice.heard} == {2: False, 3: True}
    counts = {n: s.statistics.out_of_step for n, s in simulation.services.items()}
    assert counts == {1: 1, 2: 2, 3: 1}
    assert len(caplog.messages) == 4 and "the clock of station 2" in caplog.text


def test_app_6_if_nobody_is_in_step_the_application_gets_no_plan() -> None:
    simulation, asked = three({1: 500}, until=5000)
    (choice,) = asked[1].choices
    assert choice.planned == {} and choice.heard is not None and len(choice.heard) == 2
    assert not simulation.services[1].state.bound, "it aborts"


def test_app_6_a_prescription_of_a_station_out_of_step_is_refused() -> None:
    """The prescriber does not notice: its own service does not look."""

    class Blind(McService):
        def _in_step(self, station_id: int) -> bool:
            return self.station_id == 1 or super()._in_step(station_id)

    simulation = Simulation(service=Blind)
    asked = {n: Asked() for n in (1, 2)}
    for n, application in asked.items():
        simulation.add(n, application, offset_ms=300 if n == 1 else 0)
    simulation.request(1, 1000)
    simulation.run(10_000)
    assert [choice.proposal for choice in asked[1].choices] == [1, 2, 3]
    assert asked[2].proposals == []
    assert asked[1].choices[1].reason == "unsafe"


def test_app_6_memory_is_bounded_and_each_station_is_reported_once() -> None:
    told: list[tuple[int, Bounds]] = []
    offsets = ClockOffsets(1, 10, KNOWN, lambda *found: told.append(found))
    for t in range(2 * CAMS):
        for station_id in range(2, 30):
            assert not offsets.heard(station_id, t + 500, t)
    assert told == [(n, (500, 550)) for n in range(2, 12)]
    assert {len(each) for each in offsets._cams.values()} == {CAMS}
    offsets.forget(2)
    assert 2 not in offsets._cams and 2 not in offsets._off_ms
    assert offsets.heard(2, 100, 100)
    assert in_step((100, 150)) and in_step((-150, -100))
    assert not in_step((101, 151)) and not in_step((-151, -101))


def test_app_6_the_station_s_output_names_the_station_and_a_step_of_the_host_s_clock() -> None:
    simulation, _ = three({}, until=100)
    reports: list[dict[str, Any]] = []
    complaints: list[str] = []
    process = StationProcess(
        station_id=1,
        application=Straight(),
        link=UdpLink,
        codec=JSON,
        parameters=Parameters(),
        report=reports.append,
        complain=complaints.append,
    )
    process._service = simulation.services[1]
    process._out_of_step(2, (450, 500))
    process._stepped(-1000)
    (report,) = reports
    assert {"event": "out_of_step", "src": 2, "offset_ms": [450, 500]}.items() <= report.items()
    assert complaints[0].startswith("the host's clock has stepped by -1000 ms; ")
