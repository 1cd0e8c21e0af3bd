"""The facility layer: what the service adds to a station, in virtual time."""

from __future__ import annotations

import base64
from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from automcm.application import Advertised, Application, Choice, Drive, Kinematics, Proposal
from automcm.clock import VirtualClock
from automcm.codec import MAX_BYTES
from automcm.interface import Abort, Refuse, Request
from automcm.links.simulated import Channel, Radio
from automcm.messages import (
    BROADCAST,
    Advertisement,
    Cam,
    Fin,
    Intention,
    Session,
    Trajectory,
    decode,
    encode,
)
from automcm.parameters import Parameters
from automcm.service import NEIGHBOURS, McService
from automcm.simulation import Simulation
from automcm.straight import LANE_CHANGE, Straight
from automcm_traces.reader import read

PATH = Trajectory(t0=0, points=((0, 0, 0),))


class Wire:
    """A link that keeps what is sent."""

    def __init__(self) -> None:
        self.sent: list[tuple[Any, int, str]] = []

    def open(self, receive: Any) -> None:
        self.receive = receive

    def send(self, data: bytes, to: int, tx: str) -> None:
        self.sent.append((decode(data), to, tx))

    def close(self) -> None:
        self.receive = None

    def of(self, kind: str) -> list[Any]:
        return [message for message, _, _ in self.sent if message.type == kind]


@dataclass
class Noted(Straight):
    """Straight on, noting every call."""

    calls: list[Any] = field(default_factory=list)

    def concerned(self, advertised: Advertised) -> Trajectory | None:
        self.calls.append(advertised)
        return super().concerned(advertised)

    def choose(self, choice: Choice) -> None:
        self.calls.append(choice)
        super().choose(choice)

    def verify(self, proposal: Proposal) -> None:
        self.calls.append(proposal)
        super().verify(proposal)

    def load(self, drive: Drive) -> None:
        self.calls.append(drive)
        super().load(drive)

    def fallback(self, session: Session, reason: str) -> None:
        self.calls.append(("fallback", session, reason))

    def finished(self, session: Session) -> None:
        self.calls.append(("finished", session))

    def refused(self, command: str, rule: str) -> None:
        self.calls.append(("refused", command, rule))

    def of(self, kind: type) -> list[Any]:
        return [call for call in self.calls if isinstance(call, kind)]


def alone(application: Application | None = None, **more: Any) -> tuple[McService, Wire, Any]:
    """A service of station 1 on a link that leads nowhere."""
    clock, wire = VirtualClock(), Wire()
    service = McService(1, application or Noted(), wire, clock, **more)
    service.start()
    return service, wire, clock


def pair(**more: Any) -> tuple[Noted, Noted, Simulation]:
    """A prescriber (1) and a receiver (2) on a perfect radio without delay."""
    simulation = Simulation(channel=Channel(delay_ms=(0, 0)), **more)
    prescriber, receiver = Noted(concerned_by_all=False), Noted()
    simulation.add(1, prescriber)
    simulation.add(2, receiver)
    simulation.request(1, 100)
    return prescriber, receiver, simulation


def test_act_1_the_receiver_drives_what_it_accepted_from_hold_ms_after_accepting() -> None:
    _, receiver, simulation = pair()
    accepted: list[int] = []
    simulation.services[2]._observers = (
        lambda before, effects: (
            accepted.append(effects.now_ms) if effects.rule == "NEG-2" else None
        ),
    )
    simulation.run(5000)
    (drive,), (proposal,) = receiver.of(Drive), receiver.of(Proposal)
    assert drive.role == "receiver" and drive.selected == proposal.prescribed
    assert drive.start_ms == accepted[0] + proposal.hold_ms
    assert drive.until_ms == accepted[0] + proposal.lease_ms


def test_neg_6_the_prescriber_is_told_what_the_receiver_selected_and_until_when() -> None:
    prescriber, receiver, simulation = pair()
    prescribed: list[int] = []
    simulation.services[1]._observers = (
        lambda before, effects: (
            prescribed.append(effects.now_ms) if effects.rule == "PRE-2" else None
        ),
    )
    simulation.run(9000)
    (mine,), (theirs,) = prescriber.of(Drive), receiver.of(Drive)
    assert mine.role == "prescriber" and mine.selected == theirs.selected
    assert mine.session == theirs.session == (1, 1)
    assert mine.until_ms == prescribed[0] + prescriber.lease_ms  # ACT-4: from its first sending
    assert mine.until_ms <= theirs.until_ms
    assert receiver.calls[-1] == ("finished", (1, 1))


def test_no_call_of_the_application_shows_an_ack_a_timer_or_a_seq() -> None:
    prescriber, receiver, simulation = pair()
    simulation.run(9000)
    kinds = {type(call) for call in prescriber.calls + receiver.calls}
    assert kinds == {Advertised, Choice, Proposal, Drive, tuple}
    assert not any(hasattr(call, "seq") for call in prescriber.calls + receiver.calls)


def test_pre_1_nobody_answers_is_a_fallback_that_says_so() -> None:
    application = Noted()
    service, _, clock = alone(application)
    service.command(LANE_CHANGE)
    clock.run(3000)
    assert application.calls == [("fallback", (1, 1), "no_participants")]


def test_neg_7_a_refused_proposal_is_chosen_anew_for_the_same_target() -> None:
    prescriber, receiver, simulation = pair()
    receiver.refuse_first = 1
    simulation.run(9000)
    first, second = prescriber.of(Choice)
    assert (first.proposal, first.target, set(first.planned)) == (1, 0, {2})
    assert (second.proposal, second.target, second.reason) == (2, 2, "unsafe")
    assert [p.proposal for p in receiver.of(Proposal)] == [1, 2]


def test_neg_3_a_verdict_that_comes_too_late_is_told_as_undecided() -> None:
    _, receiver, simulation = pair()
    receiver.think_ms = 600
    simulation.run(5000)
    assert ("refused", "undecided", "NEG-3") in receiver.calls
    assert any(call[:2] == ("refused", "accept") for call in receiver.of(tuple))


def test_cmd_1_a_command_that_no_rule_provides_for_is_told_as_refused() -> None:
    application = Noted()
    service, _, _ = alone(application)
    service.command(Abort(session=(1, 1)))
    assert application.calls == [("refused", "abort", "CMD-1")]


def test_a_command_given_within_a_callback_is_carried_out_after_it() -> None:
    class Hasty(Noted):
        def choose(self, choice: Choice) -> None:
            self.service.command(choice.abort())
            self.calls.append(service.state.phase)

    application = Hasty(concerned_by_all=False)
    simulation = Simulation(channel=Channel(delay_ms=(0, 0)))
    service = simulation.add(1, application)
    simulation.add(2, Noted())
    simulation.request(1, 0)
    simulation.run(4000)
    assert application.calls == ["CHOOSING"] and service.state.phase == "STANDALONE"


def test_act_2_cams_go_out_at_t_cam_in_every_phase_with_the_marks() -> None:
    service, wire, clock = alone(parameters=Parameters(t_cam=250))
    service.command(LANE_CHANGE)
    clock.run(2000)
    service.close()
    cams = wire.of("CAM")
    times = [cam.generation_ms for cam in cams]
    assert len(times) == 8 and {b - a for a, b in pairwise(times)} == {250}
    assert all(cam.marks == ((1, 1),) for cam in cams)
    assert all(to == BROADCAST for message, to, _ in wire.sent if message.type == "CAM")


def test_a_cam_says_where_the_application_is() -> None:
    class Parked(Noted):
        def kinematics(self, now_ms: int) -> Kinematics:
            return Kinematics(1000, -200, 1571, 5)

    _, wire, clock = alone(Parked())
    clock.run(100)
    cam = wire.of("CAM")[0]
    assert (cam.x_mm, cam.y_mm, cam.heading_mrad, cam.speed_mm_s) == (1000, -200, 1571, 5)


def cam(src: int, generation_ms: int) -> bytes:
    return encode(
        Cam(
            src=src,
            generation_ms=generation_ms,
            x_mm=0,
            y_mm=0,
            heading_mrad=0,
            speed_mm_s=0,
            marks=(),
        )
    )


def test_mem_1_the_neighbours_kept_are_those_heard_last_and_not_oneself() -> None:
    service, wire, _ = alone()
    for src in range(2, NEIGHBOURS + 12):
        wire.receive(cam(src, 1), None)
    wire.receive(cam(12, 2), None)
    wire.receive(cam(1, 3), None)
    assert len(service.neighbours) == NEIGHBOURS
    assert list(service.neighbours)[-2:] == [NEIGHBOURS + 11, 12]
    assert 11 not in service.neighbours and 1 not in service.neighbours


def test_end_5_what_is_wrong_is_counted_by_what_is_wrong_with_it() -> None:
    service, wire, _ = alone()
    fin: dict[str, Any] = {"src": 2, "session": (2, 1), "seq": 1}
    heard = [
        b"\x00\xff",
        b"x" * (MAX_BYTES + 1),
        encode(Fin(**fin, dst=7)),
        encode(Fin(src=1, dst=1, session=(2, 1), seq=1)),
        encode(Fin(**fin, dst=1)),
        encode(Fin(**fin, dst=1)),
        cam(3, 5),
    ]
    sources = [wire.receive(data, None) for data in heard]
    assert sources == [None, None, 2, 1, 2, 2, 3]
    s = service.statistics
    assert (s.malformed, s.oversized, s.elsewhere, s.broken, s.foreign) == (2, 1, 1, 1, 2)
    assert s.received == {"Fin": 4, "CAM": 1} and s.received_bytes == sum(map(len, heard))
    assert s.rules == {"END-5": 3, "MSG-1": 1, "END-3": 2, "ACT-5": 1}
    assert s.sent == {"Ack": 2}  # each copy (END-3)
    assert s.as_dict()["rules"] == dict(sorted(s.rules.items()))


def test_end_5_copies_within_the_session_are_counted_as_repeated() -> None:
    _, _, simulation = pair()
    simulation.radio.channel = Channel(duplicate=1.0, delay_ms=(0, 0))
    simulation.run(9000)
    assert simulation.services[2].statistics.repeated > 20  # of 21 Advertisements, for a start


def test_what_the_codec_cannot_carry_is_as_if_lost_and_counted() -> None:
    application = Noted()
    service, wire, clock = alone(application)
    huge = Trajectory(t0=0, points=((0, 0, 0),) * 20_000)
    service.command(Request(scenario="x", planned=huge))
    clock.run(3000)
    assert wire.of("Advertisement") == [] and service.statistics.unsendable == 21
    assert application.calls == [("fallback", (1, 1), "no_participants")]


def test_an_application_that_raises_stops_no_session() -> None:
    class Faulty(Noted):
        def verify(self, proposal: Proposal) -> None:
            raise RuntimeError("a bug")

    simulation = Simulation(channel=Channel(delay_ms=(0, 0)))
    simulation.add(1, Noted(concerned_by_all=False))
    simulation.add(2, Faulty())
    simulation.request(1, 0)
    for _ in range(3):  # rounds
        with pytest.raises(RuntimeError, match="a bug"):
            simulation.clock.run(20_000)
    simulation.clock.run(20_000)
    assert {service.state.phase for service in simulation.services.values()} == {"STANDALONE"}
    assert simulation.services[2].statistics.rules["NEG-3"] == 3  # no verdict in time


def advertisement(src: int, number: int = 1) -> bytes:
    return encode(Advertisement(src=src, session=(src, number), seq=1, scenario="x", details={}))


def test_what_was_due_happens_even_if_the_application_raises_when_asked_to_join() -> None:
    class Faulty(Noted):
        def concerned(self, advertised: Advertised) -> Trajectory | None:
            raise RuntimeError("a bug")

    application, clock, wire = Faulty(), Jumpy(), Wire()
    service = McService(1, application, wire, clock)
    service.start()
    service.command(LANE_CHANGE)
    clock.time = 2100  # the window closes just before the Advertisement is read
    with pytest.raises(RuntimeError, match="a bug"):
        wire.receive(advertisement(2), None)
    assert application.calls == [("fallback", (1, 1), "no_participants")]
    assert service.statistics.rules["PRE-1"] == 1 and len(clock.alarms) == 1


def test_an_exception_keeps_nobody_else_from_being_told() -> None:
    application = Noted()
    clock, wire = VirtualClock(), Wire()

    def breaks(before: object, effects: object) -> None:
        raise RuntimeError("an observer's bug")

    seen: list[str] = []
    service = McService(
        1,
        application,
        wire,
        clock,
        observers=(breaks, lambda before, effects: seen.append(effects.rule)),
    )
    service.start()
    with pytest.raises(RuntimeError, match="an observer's bug"):
        service.command(Abort(session=(1, 1)))
    assert (application.calls, seen) == ([("refused", "abort", "CMD-1")], ["CMD-1"])


def test_end_8_while_a_number_cannot_be_kept_nothing_goes_on_the_air() -> None:
    broken = True

    def keep(number: int) -> None:
        if broken:
            raise OSError("disk full")

    service, wire, clock = alone(keep_number=keep)
    with pytest.raises(OSError, match="disk full"):
        service.command(LANE_CHANGE)
    for _ in range(5):
        with pytest.raises(OSError, match="disk full"):
            clock.run(clock.now() + 100)
    assert wire.of("Advertisement") == []
    broken = False
    clock.run(clock.now() + 1000)
    assert len(wire.of("Advertisement")) > 5


def test_a_position_that_raises_delays_the_next_cam_and_no_more() -> None:
    class Lost(Noted):
        asked = 0

        def kinematics(self, now_ms: int) -> Kinematics:
            self.asked += 1
            raise RuntimeError("no position")

    application = Lost()
    _, wire, clock = alone(application)
    for _ in range(10):
        with pytest.raises(RuntimeError, match="no position"):
            clock.run(1000)
    clock.run(1000)
    assert application.asked == 10 and wire.of("CAM") == []


def test_a_command_given_before_the_start_is_carried_out_then() -> None:
    clock, wire = VirtualClock(), Wire()
    service = McService(1, Noted(), wire, clock)
    service.command(LANE_CHANGE)
    assert wire.sent == []
    service.start()
    assert len(wire.of("Advertisement")) == 1


def test_a_service_closed_within_a_callback_sends_nothing_more() -> None:
    class Quits(Noted):
        def fallback(self, session: Session, reason: str) -> None:
            self.service.command(LANE_CHANGE)
            service.close()

    service, wire, clock = alone(Quits())
    service.command(LANE_CHANGE)
    clock.run(9000)
    assert len(wire.of("Advertisement")) == 21
    assert {a.session for a in wire.of("Advertisement")} == {(1, 1)}


def test_a_service_can_be_started_again() -> None:
    service, wire, clock = alone()
    clock.run(500)
    service.close()
    clock.run(1000)
    before = len(wire.of("CAM"))
    service.start()
    clock.run(2000)
    assert len(wire.of("CAM")) - before == pytest.approx(10, abs=1)


def test_end_5_the_application_is_not_asked_about_its_own_echo_nor_when_it_is_bound() -> None:
    application = Noted()
    _, wire, _ = alone(application)
    wire.receive(advertisement(1), None)
    assert application.calls == []
    for src in (2, 2, 3):
        wire.receive(advertisement(src), None)
    assert [call.session for call in application.calls] == [(2, 1)]


def test_a_log_holds_cams_raw_bytes_and_the_transmission_of_each_input(tmp_path: Path) -> None:
    simulation = Simulation(logs=tmp_path)
    simulation.add(1, Straight())
    simulation.add(2, Straight())
    simulation.request(1, 100)
    simulation.clock.at(300, lambda: simulation.services[2].receive(b"rubbish", "9:9"))
    simulation.run(3000)
    events = [event for _, event in read(tmp_path / "2.ndjson").events]
    sent = [e for e in events if e.ev == "send"]
    assert Counter(e.message["type"] for e in sent)["CAM"] >= 29
    (raw,) = [e for e in events if e.ev == "receive" and e.raw]
    assert base64.b64decode(raw.raw or "") == b"rubbish" and raw.tx == "9:9"
    received = [e for e in events if e.ev == "receive"]
    assert all(e.tx for e in received)
    by_1 = {e.tx: e.message for _, e in read(tmp_path / "1.ndjson").events if e.ev == "send"}
    assert all(by_1[e.tx] == e.message for e in received if e.message)


def test_end_8_the_number_is_kept_before_it_goes_on_the_air() -> None:
    kept: list[tuple[int, int]] = []
    service, wire, clock = alone(
        number=41, keep_number=lambda number: kept.append((number, len(wire.of("Advertisement"))))
    )
    service.command(LANE_CHANGE)
    clock.run(10_000)
    service.command(LANE_CHANGE)
    assert kept == [(42, 0), (43, 21)]
    assert {a.session for a in wire.of("Advertisement")} == {(1, 42), (1, 43)}


def test_end_8_a_restart_forgets_the_session_and_joins_none_for_a_while() -> None:
    prescriber, receiver, simulation = pair()
    simulation.restart(2, 3000)
    simulation.run(3000)
    assert simulation.services[2].state.quarantine
    assert ("fallback", (1, 1), "restart") in receiver.calls
    simulation.run(6000)
    assert ("fallback", (1, 1), "cam_loss") in prescriber.calls


def test_a_closed_service_does_nothing_more() -> None:
    service, wire, clock = alone()
    service.command(LANE_CHANGE)
    service.close()
    sent = len(wire.sent)
    service.command(LANE_CHANGE)
    assert service.receive(cam(2, 1)) is None
    clock.run(5000)
    assert len(wire.sent) == sent and service.statistics.received == {}


class Jumpy:
    """A clock that wakes too early, or stands still or goes back for a while."""

    def __init__(self) -> None:
        self.time, self.alarms = 0, list[tuple[int, Any]]()

    def now(self) -> int:
        return self.time

    def at(self, when_ms: int, do: Any) -> Any:
        alarm = when_ms, do
        self.alarms.append(alarm)
        return lambda: alarm in self.alarms and self.alarms.remove(alarm)

    def ring(self, time: int) -> None:
        """Wake for the next alarm although it is only ``time``."""
        self.time = time
        alarm = min(self.alarms, key=lambda alarm: alarm[0])
        self.alarms.remove(alarm)
        alarm[1]()


def test_an_alarm_that_rings_early_or_a_clock_that_goes_back_stalls_nothing() -> None:
    clock, wire = Jumpy(), Wire()
    service = McService(1, Noted(), wire, clock)
    service.start()
    service.command(LANE_CHANGE)
    for n in range(60):
        clock.ring(time=max(0, 50 * n - 70))
    assert len(wire.of("Advertisement")) == 21 and service.state.phase == "STANDALONE"
    assert len(clock.alarms) == 1  # a single alarm


def test_one_alarm_is_set_however_much_happens() -> None:
    clock, wire = Jumpy(), Wire()
    service = McService(1, Noted(), wire, clock)
    service.start()
    service.command(LANE_CHANGE)
    for src in range(2, 8):
        intention = Intention(src=src, dst=1, session=(1, 1), seq=1, planned=PATH)
        wire.receive(encode(intention), None)
        assert len(clock.alarms) == 1
    assert clock.alarms[0][0] == min(service.station.next_deadline() or 0, service._cam_due)


def test_statistics_say_how_late_an_alarm_was() -> None:
    clock, wire = Jumpy(), Wire()
    service = McService(1, Noted(), wire, clock)
    service.start()
    due = clock.alarms[0][0]
    clock.ring(due + 70)
    assert service.statistics.latest_ms == 70


def test_the_same_seed_gives_the_same_session_on_a_radio_with_everything(tmp_path: Path) -> None:
    logs = []
    for name in "ab":
        (tmp_path / name).mkdir()
        channel = Channel(loss=0.2, duplicate=0.2, reorder=0.3, delay_ms=(1, 20))
        simulation = Simulation(seed=5, channel=channel, logs=tmp_path / name)
        for station_id in (1, 2, 3):
            simulation.add(station_id, Straight())
        simulation.request(1, 100)
        simulation.run(8000)
        logs.append([path.read_bytes() for path in sorted((tmp_path / name).iterdir())])
    assert logs[0] == logs[1]


def test_refuse_is_a_command_of_its_proposal() -> None:
    proposal = Proposal((1, 1), 2, PATH, 0, 1)
    assert proposal.refuse() == Refuse(session=(1, 1), proposal=2)
    assert proposal.accept().selected == PATH


def test_a_radio_has_one_link_for_each_station() -> None:
    radio = Radio(VirtualClock())
    radio.link(1)
    with pytest.raises(ValueError, match="station_id: 1"):
        radio.link(1)
