"""Short stories of single rules, told with two stations and no radio."""

from __future__ import annotations

from automcm.station import Effects, Station
from automcm_spec.application import Abort, Accept, Prescribe, Proceed, Request
from automcm_spec.messages import Message, Trajectory

DRIVEN = Trajectory(t0=0, points=((0, 0, 0), (1000, 8000, 0)))
A, B, C = 1, 2, 3


def station(id_: int) -> Station:
    return Station(id_, plan=lambda _: DRIVEN)


def sent(effects: list[Effects]) -> list[Message]:
    return [message for effect in effects for message in effect.messages]


def advertised(prescriber: Station) -> Message:
    return sent(prescriber.command(Request(scenario="lane_change", details={}), 0))[0]


def recorded(prescriber: Station, *receivers: Station) -> None:
    """The receivers intend; the window closes."""
    advertisement = advertised(prescriber)
    for receiver in receivers:
        (intention,) = sent(receiver.receive(advertisement, 1))
        receiver.receive(sent(prescriber.receive(intention, 2))[0], 3)
    prescriber.advance(2100)


def test_adv_4_a_bound_station_ignores_an_advertisement() -> None:
    a, b, c = station(A), station(B), station(C)
    b.receive(advertised(a), 1)
    before = b.state
    (effect,) = b.receive(advertised(c), 2)
    assert (effect.rule, effect.messages) == ("ADV-4", ()) and b.state == before


def test_adv_4_end_7_two_that_advertise_ignore_each_other() -> None:
    a, b = station(A), station(B)
    first, second = advertised(a), advertised(b)
    assert sent(a.receive(second, 1)) == [] and sent(b.receive(first, 1)) == []
    assert a.state.phase == b.state.phase == "ADVERTISING"


def test_pre_3_proceeding_alone_releases_everybody() -> None:
    a, b, c = station(A), station(B), station(C)
    recorded(a, b, c)
    cancels = sent(a.command(Proceed(session=(A, 1)), 2200))
    assert [(m.type, m.dst, m.model_dump()["reason"]) for m in cancels] == [
        ("Cancel", B, "not_needed"),
        ("Cancel", C, "not_needed"),
    ]
    assert a.state.phase == "STANDALONE"
    b.receive(cancels[0], 2201)
    assert b.state.phase == "STANDALONE"


def prescribed(a: Station, *receivers: Station) -> None:
    recorded(a, *receivers)
    command = Prescribe(
        session=(A, 1), proposal=1, target=B, prescribed=DRIVEN, hold_ms=2000, lease_ms=20_000
    )
    receivers[0].receive(sent(a.command(command, 2200))[0], 2201)


def test_neg_2_the_receiver_is_committed_from_the_first_sending() -> None:
    a, b = station(A), station(B)
    prescribed(a, b)
    assert b.state.phase == "NEGOTIATING"
    (acceptance,) = sent(b.command(Accept(session=(A, 1), proposal=1, selected=DRIVEN), 2300))
    assert b.state.phase == "ACTUATING" and a.state.phase == "PRESCRIBING"
    a.receive(acceptance, 2301)
    assert a.state.phase == "ACTUATING"


def test_end_1_an_abort_goes_to_every_recorded_station_before_the_choice() -> None:
    a, b, c = station(A), station(B), station(C)
    recorded(a, b, c)
    cancels = sent(a.command(Abort(session=(A, 1)), 2200))
    assert [m.dst for m in cancels] == [B, C] and a.state.phase == "STANDALONE"


def test_end_1_leaving_ends_the_acceptance_but_not_the_cancel() -> None:
    a, b = station(A), station(B)
    prescribed(a, b)
    b.command(Accept(session=(A, 1), proposal=1, selected=DRIVEN), 2300)
    assert [m.type for m in b.state.outbox] == ["Acceptance"]
    b.command(Abort(session=(A, 1)), 2350)
    assert [m.type for m in b.state.outbox] == ["Cancel"]
    assert {timer.name for timer in b.timers} == {"giveup", "resend", "forget", "quarantine"}


def test_act_6_a_receiver_that_breaks_off_joins_and_requests_nothing_for_a_while() -> None:
    a, b, c = station(A), station(B), station(C)
    prescribed(a, b)
    b.command(Accept(session=(A, 1), proposal=1, selected=DRIVEN), 2300)
    b.command(Abort(session=(A, 1)), 2350)
    assert not sent(b.receive(advertised(c), 2360))
    b.command(Request(scenario="lane_change", details={}), 2370)
    assert b.state.phase == "STANDALONE"
    b.advance(2350 + 6300)
    b.command(Request(scenario="lane_change", details={}), 2350 + 6301)
    assert b.state.phase == "ADVERTISING"
