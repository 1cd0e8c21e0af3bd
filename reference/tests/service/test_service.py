"""The service: what an application sees and does, logs, restarts and clocks."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import automcm_stage
from service_stage import PATH, Jumpy, Noted, alone, cam, pair

from automcm.links.simulated_radio import Channel
from automcm.service.application import (
    Advertised,
    AgreedManeuver,
    Choice,
    CloseWindow,
    Proposal,
    all_answered,
)
from automcm.service.service import McService
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import LANE_CHANGE
from automcm_spec.vocabulary.messages import BROADCAST, Cancel, Intention, encode
from automcm_spec.vocabulary.parameters import Parameters


def test_act_1_neg_6_both_drive_what_was_accepted_and_each_knows_from_when_until_when() -> None:
    prescriber, receiver, simulation = pair()
    at: dict[str, int] = {}
    for service in simulation.services.values():
        service._observers = (lambda before, effects: at.setdefault(effects.rule, effects.now_ms),)
    simulation.run(9000)
    (mine,), (theirs,) = prescriber.of(AgreedManeuver), receiver.of(AgreedManeuver)
    (proposal,) = receiver.of(Proposal)
    assert (mine.role, theirs.role) == ("prescriber", "receiver")
    assert mine.selected == theirs.selected == proposal.prescribed
    assert mine.session == theirs.session == (1, 1)
    assert theirs.start_ms == at["NEG-2"] + proposal.hold_ms
    assert theirs.until_ms == at["NEG-2"] + proposal.lease_ms
    lasts = prescriber.lease_ms - 201  # ACT-4: from its first sending, shorter by 1 % and 1 ms
    assert mine.until_ms == at["PRE-2"] + lasts <= theirs.until_ms
    assert receiver.calls[-1] == ("finished", (1, 1))
    calls = prescriber.calls + receiver.calls
    assert {type(call) for call in calls} == {Advertised, Choice, Proposal, AgreedManeuver, tuple}
    assert not any(hasattr(call, "seq") for call in calls)


def chosen_at(
    close_window: CloseWindow | None, deaf: tuple[int, ...] = (), stations: int = 3
) -> tuple[int, set[int]]:
    """When the prescriber may choose, in ms after its request at 1000, and from whom.

    Not concerned are the stations in ``deaf``.
    """
    service = partial(McService, close_window=close_window)
    simulation = Simulation(channel=Channel(delay_ms=(0, 0)), service=service)
    prescriber = Noted(concerned_by_all=False)
    at: dict[str, int] = {}
    simulation.add(
        1,
        prescriber,
        observers=(lambda before, effects: at.setdefault(effects.state.phase, effects.now_ms),),
    )
    for station_id in range(2, stations + 1):
        simulation.add(station_id, Noted(concerned_by_all=station_id not in deaf))
    simulation.request(1, 1000)
    simulation.run(5000)
    assert not [call for call in prescriber.of(tuple) if call[0] == "refused"]
    return at["CHOOSING"] - 1000, set(prescriber.of(Choice)[0].planned)


def test_adv_9_the_window_closes_when_every_known_neighbour_has_answered() -> None:
    end = Parameters().t_advertise
    assert chosen_at(None) == (end, {2, 3})
    assert chosen_at(all_answered) == (0, {2, 3})
    assert chosen_at(all_answered, deaf=(3,)) == (end, {2})  # somebody has not answered
    assert chosen_at(lambda answered, heard: 2 in answered) == (0, {2})  # as the application likes


def test_adv_9_without_a_known_neighbour_the_window_stays_open() -> None:
    assert not all_answered({2}, ())
    service, wire, _ = alone(close_window=all_answered)
    service.command(LANE_CHANGE)
    service.receive(encode(Intention(src=2, dst=1, session=(1, 1), seq=1, planned=PATH)))
    assert service.state.phase == "ADVERTISING"
    service.receive(cam(3, 10))
    assert service.state.phase == "ADVERTISING"  # 3 has not answered
    service.receive(encode(Intention(src=3, dst=1, session=(1, 1), seq=1, planned=PATH)))
    assert service.state.phase == "CHOOSING"
    service.receive(encode(Intention(src=4, dst=1, session=(1, 1), seq=1, planned=PATH)))
    assert wire.of("Cancel")[-1].reason == "closed"  # ADV-5, as after the expiry


def test_adv_9_the_window_stays_open_if_all_have_withdrawn() -> None:
    service, _, _ = alone(close_window=all_answered)
    service.command(LANE_CHANGE)
    service.receive(cam(2, 10))
    service.receive(encode(Cancel(src=2, dst=1, session=(1, 1), seq=1, reason="abort")))
    assert service.state.phase == "ADVERTISING" and not service.application.calls
    service.receive(encode(Intention(src=3, dst=1, session=(1, 1), seq=1, planned=PATH)))
    assert service.state.phase == "CHOOSING"  # 2 has answered, too


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


def test_app_1_the_application_knows_the_extent_of_whom_it_hears() -> None:
    service, _, clock = alone()
    clock.run(100)
    bare = automcm_stage.cam(2, 1)
    for src, fields in ((2, {}), (3, {"station_type": 8, "sigma_mm": 700, "width_mm": 2500})):
        service.receive(encode(bare.model_copy(update={"src": src} | fields)))
    heard = [(h.length_mm, h.width_mm, h.sigma_mm) for h in service.heard()]
    assert heard == [(4500, 1800, None), (18_750, 2500, 700)]


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
    service, wire, clock = alone(clock=Jumpy())
    service.command(LANE_CHANGE)
    for n in range(60):
        clock.ring(time=max(0, 50 * n - 70))
    assert len(wire.of("Advertisement")) == 21 and service.state.phase == "STANDALONE"
    assert len(clock.alarms) == 1  # a single alarm
