"""The service: what an application sees and does, logs, restarts and clocks."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from service_stage import PATH, Jumpy, Noted, Wire, alone, cam, pair

from automcm.application import Advertised, Choice, Drive, Kinematics, Proposal
from automcm.clock import VirtualClock
from automcm.links.simulated import Channel, Radio
from automcm.service import McService
from automcm.simulation import Simulation
from automcm.straight import LANE_CHANGE, Straight
from automcm_spec.application import Abort, Refuse
from automcm_spec.messages import BROADCAST, Intention, encode
from automcm_spec.parameters import Parameters


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
    lasts = prescriber.lease_ms - 201  # ACT-4: from its first sending, shorter by 1 % and 1 ms
    assert mine.until_ms == prescribed[0] + lasts
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
