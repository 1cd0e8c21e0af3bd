"""KIN-7, against mpmath, counting and the knees of Fig. 9."""

from __future__ import annotations

import mpmath
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_trajectory_cases import BAD, numbers, raises

from automcm_simulation.radio import success
from automcm_spec.vocabulary.parameters import Parameters

losses = st.floats(0, 1)
counts = st.integers(1, 50)


@given(st.integers(0, 10_000), st.integers(1, 1000))
def test_sendings_count_the_instants(t_timeout: int, t_resend: int) -> None:
    """At 0, t_resend, ... up to t_timeout; in ms and in s."""
    n = len(range(0, t_timeout + 1, t_resend))
    assert success.sendings(t_timeout, t_resend) == n
    assert success.sendings(t_timeout / 1000, t_resend / 1000) == n


def test_sendings_of_table_i() -> None:
    assert [success.sendings(t, 100) for t in (0, 1000, 2000)] == [1, 11, 21]
    assert success.sendings(0.3, 0.1) == 4
    given_up = Parameters(t_timeout=2000, t_resend=100).t_giveup
    assert given_up == 100 * success.sendings(2000, 100)


@given(losses, counts)
def test_against_mpmath(loss: float, n: int) -> None:
    with mpmath.workdps(60):
        lam = mpmath.mpf(loss)
        q = (1 - lam) ** 2
        expected = 1 - lam**n, 1 - (1 - q) ** n, (1 - (1 - q) ** n) ** 3
    for name, value in zip(("message", "exchange", "session"), expected, strict=True):
        assert getattr(success, name)(loss, n) == pytest.approx(float(value), abs=1e-14), name


def test_knees_of_fig_9() -> None:
    """The session stays above 85 % one tenth before the paper's knee, and falls below 65 % at or
    one tenth after it; Eq. 2 alone stays above 99 % at the later two."""
    for t_timeout, before, knee in ((0, 0.0, 0.1), (1000, 0.5, 0.6), (2000, 0.6, 0.7)):
        n = success.sendings(t_timeout, 100)
        assert success.session(before, n) > 0.85
        assert success.session(knee, n) < 0.65
    assert (success.message([0.6, 0.7], 11) > 0.98).all()


@given(numbers(-2, 3), counts)
def test_refused_outside(loss: float, n: int) -> None:
    if 0 <= loss <= 1:
        return
    for kernel in (success.message, success.exchange, success.session):
        raises("loss: ", lambda kernel=kernel: kernel(loss, n))
        raises("loss[1]: ", lambda kernel=kernel: kernel([0.5, loss], n))


def test_refused() -> None:
    for bad in BAD:
        raises("loss", lambda bad=bad: success.message(bad, 1))
        raises("t_timeout", lambda bad=bad: success.sendings(bad, 100))
        raises("t_resend", lambda bad=bad: success.sendings(100, bad))
    raises("t_timeout", lambda: success.sendings(-1, 100))
    raises("t_resend", lambda: success.sendings(100, 0))
    raises("t_resend", lambda: success.sendings(1e12, 1e-300))
    for n in (0, -1, 1.5, True, None):
        raises("n: ", lambda n=n: success.message(0.5, n))
    raises("loss: must be an array", lambda: success.message("x", 1))
