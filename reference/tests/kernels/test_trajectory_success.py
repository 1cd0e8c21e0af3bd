"""KIN-7, against mpmath, counting and the knees of Fig. 9."""

from __future__ import annotations

import itertools

import mpmath
import numpy as np
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


@given(losses, st.integers(1, 5))
def test_exchange_counts_outcomes(loss: float, n: int) -> None:
    """Every way in which n copies and n answers may be lost or not."""
    total = 0.0
    for lost in itertools.product((False, True), repeat=2 * n):
        if any(not lost[k] and not lost[n + k] for k in range(n)):
            total += np.prod([loss if each else 1 - loss for each in lost])
    assert success.exchange(loss, n) == pytest.approx(total, abs=1e-12)


@given(losses, losses, counts, counts)
def test_monotone_and_ordered(one: float, two: float, n: int, more: int) -> None:
    low, high = sorted((one, two))
    for kernel in (success.message, success.exchange, success.session):
        assert 0 <= kernel(high, n) <= kernel(low, n) + 1e-14 <= 1 + 1e-14
        assert kernel(low, n + more) >= kernel(low, n) - 1e-14
    assert success.session(one, n) <= success.exchange(one, n) + 1e-14
    assert success.exchange(one, n) <= success.message(one, n) + 1e-14


@given(st.lists(losses, min_size=2, max_size=6), counts)
def test_vectorised(loss: list[float], n: int) -> None:
    for kernel in (success.message, success.exchange, success.session):
        made = kernel([loss, loss[::-1]], n)
        assert made.shape == (2, len(loss))
        assert made[0] == pytest.approx([float(kernel(each, n)) for each in loss], abs=1e-14)
        assert made[1] == pytest.approx(made[0][::-1], abs=1e-14)


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
