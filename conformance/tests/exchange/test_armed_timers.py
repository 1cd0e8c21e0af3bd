"""Which armed timer fires next."""

from __future__ import annotations

from automcm_conformance.exchange.armed_timers import UNKNOWN, ArmedTimers
from automcm_spec.vocabulary.station import Entry, Timer


def test_timers_fire_by_deadline_then_rank_then_age() -> None:
    clock: ArmedTimers[Timer] = ArmedTimers()
    clock.arm(("lease",), 200)
    clock.arm(("cam",), 200)
    clock.arm(("forget", 3), 100)
    fired = []
    while (timer := clock.due(200)) is not None:
        clock.stop(timer)
        fired.append(timer)
    assert fired == [("forget", 3), ("cam",), ("lease",)]


def test_an_older_message_is_sent_again_first() -> None:
    clock: ArmedTimers[Timer] = ArmedTimers()
    one, two = (("resend", Entry("Cancel", p, (1, 1), 1, False)) for p in (2, 3))
    for timer in (one, two, one):  # armed anew, and still the older one
        clock.inputs += 1
        clock.arm(timer, 100, timer, "Cancel")
    assert clock.due(99) is None and clock.due(100) == one
    clock.stop(one)
    clock.inputs += 1
    clock.arm(one, 100, one, "Cancel")  # a new message, equal to one that is over
    assert clock.due(100) == two


def test_what_only_the_station_knows_is_not_sure() -> None:
    clock: ArmedTimers[Timer] = ArmedTimers()
    clock.arm(("backoff",), UNKNOWN)
    assert clock.first is None and not clock.sure
    clock.learn(("backoff",), 700)
    assert clock.sure and clock.deadline(("backoff",)) == 700 and clock.deadline(("cam",)) is None
