"""Parameters: what is derived, and what is refused."""

from __future__ import annotations

from typing import Any

import pytest

from automcm.parameters import ParameterError, Parameters
from automcm.state import Timer


@pytest.mark.parametrize(("t_timeout", "n"), [(2000, 21), (1000, 11), (0, 1), (2050, 21)])
def test_t_giveup_is_one_resend_after_the_last_of_n_transmissions(t_timeout: int, n: int) -> None:
    p = Parameters(t_timeout=t_timeout)
    assert p.t_giveup == n * p.t_resend
    assert len(range(0, p.t_giveup, p.t_resend)) == n


def test_derived_durations_with_the_defaults() -> None:
    p = Parameters()
    assert (p.t_giveup, p.t_advertise, p.t_life) == (2100, 2100, 4200)
    assert p.t_hold == 2100 + 500 + 2 * 2100


@pytest.mark.parametrize(
    ("name", "ms"),
    [
        ("advertise", 2100),
        ("resend", 100),
        ("decide", 500),
        ("hold", 6800),
        ("answer", 2600),
        ("cam", 1500),
        ("giveup", 2100),
        ("quarantine", 6300),
    ],
)
def test_duration_of_each_timer_with_the_defaults(name: str, ms: int) -> None:
    assert Parameters().duration(Timer(name)) == ms


@pytest.mark.parametrize("name", ["lease", "forget", "backoff"])
def test_a_timer_without_a_fixed_duration_has_none(name: str) -> None:
    with pytest.raises(ValueError, match=name):
        Parameters().duration(Timer(name))


def test_as_dict_holds_the_derived_ones_too() -> None:
    out = Parameters(t_timeout=0).as_dict()
    assert out["t_timeout"] == 0
    assert {n: out[n] for n in ("t_giveup", "t_advertise", "t_hold", "t_life")} == {
        "t_giveup": 100,
        "t_advertise": 100,
        "t_hold": 800,
        "t_life": 200,
    }


OWN_LEASES = [
    *((1, 20_000, 19_799), (1, 100, 98), (1, 101, 98), (7, 900, 836), (0, 20_000, 20_000)),
    *((1, 1, 1), (99, 10, 1)),  # too short to act on, but no timer lasts less than 1 ms
]


@pytest.mark.parametrize(("drift", "lease_ms", "own_ms"), OWN_LEASES)
def test_act_4_the_prescribers_lease_is_shorter_by_the_drift_and_1_ms(
    drift: int, lease_ms: int, own_ms: int
) -> None:
    p = Parameters(clock_drift=drift)
    assert p.lease("prescriber", lease_ms) == own_ms
    assert p.lease("receiver", lease_ms) == lease_ms


@pytest.mark.parametrize("drift", [1, 3, 10, 50])
def test_act_4_a_clock_slow_by_the_drift_still_ends_first(drift: int) -> None:
    for lease_ms in range(200, 30_000, 7):
        own_ms = Parameters(clock_drift=drift).lease("prescriber", lease_ms)
        assert own_ms * (100 + drift) <= (lease_ms - 1) * 100


NAMES = [name for name in Parameters().as_dict() if name not in ("t_giveup", "t_advertise")]
NAMES = [name for name in NAMES if name not in ("t_hold", "t_life")]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("value", [-1, 1500.0, "1500", True, None])
def test_a_parameter_is_an_integer_and_not_negative(name: str, value: Any) -> None:
    with pytest.raises(ParameterError, match=f"^{name}: "):
        Parameters(**{name: value})


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("t_resend", {"t_resend": 0}),
        ("t_cam", {"t_cam": 0}),
        ("t_cam", {"t_cam": 1001}),
        ("t_cam_loss", {"t_cam_loss": 1000}),
        ("max_rounds", {"max_rounds": 0}),
        ("max_participants", {"max_participants": 0}),
        ("memory_limit", {"memory_limit": 0}),
        ("outbox_limit", {"outbox_limit": 32}),
        ("outbox_limit", {"max_participants": 64}),
        ("backoff_max", {"backoff_min": 2001}),
        ("clock_drift", {"clock_drift": 100}),
    ],
)
def test_a_parameter_that_cannot_work_is_refused_by_name(name: str, given: dict[str, int]) -> None:
    with pytest.raises(ParameterError, match=f"^{name}: "):
        Parameters(**given)


@pytest.mark.parametrize(
    "given",
    [
        {"t_timeout": 0, "t_decide": 0},
        {"t_cam_loss": 1001, "t_cam": 1000},
        {"max_participants": 1, "outbox_limit": 2, "memory_limit": 1, "max_rounds": 1},
        {"backoff_min": 0, "backoff_max": 0},
        {"clock_drift": 0},
        {"clock_drift": 99},
    ],
)
def test_the_bounds_themselves_are_allowed(given: dict[str, int]) -> None:
    assert Parameters(**given).as_dict().items() >= given.items()
