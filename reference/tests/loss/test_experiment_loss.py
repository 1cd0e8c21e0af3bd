"""The experiment on packet loss: sessions, drives, models, verdicts."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest

from automcm.applications.vehicle import Vehicle
from automcm.links.simulated_radio import Channel
from automcm_evaluation.framework.experiment import Cell, ExperimentError
from automcm_evaluation.framework.intervals import wilson
from automcm_evaluation.loss import loss_road, loss_sessions
from automcm_evaluation.loss.loss_tables import (
    T_TIMEOUTS,
    classes,
    cost,
    eq2,
    falls,
    four_messages,
    one_message,
    three_exchanges,
)
from automcm_simulation.road.drive import SimulatedDrive

Json = Any


def block(t_timeout: int, loss: int, trials: int = 100, burst_ms: int = 0) -> Json:
    values = {"t_timeout": t_timeout, "loss": loss, "trials": trials, "burst_ms": burst_ms}
    return loss_sessions.block(values, 7)


def drive(t_timeout: int, loss: int, seed: int = 3) -> Json:
    values = {"t_timeout": t_timeout, "loss": loss, "target_m": 260.0}
    return loss_road.drive(values, seed, beside_m=5.0, signal_m=50.0)


# -- sessions


def test_without_loss_all_agree_and_with_nothing_but_loss_none() -> None:
    assert block(0, 0)["agreed"] == 100 and block(2000, 0, 10)["agreed"] == 10
    nothing = {"agreed": 0, "sent": 0, "agreed_ms": 0, "bins": []}
    assert block(1000, 100, 10) | {"sent": 0} == nothing


def test_a_session_without_loss_takes_the_window_and_what_is_sent_in_it() -> None:
    found = loss_sessions.session(1000, Channel(), 1)
    assert found.agreed and 1100 <= found.after_ms <= 1300
    assert found.sent == 11 + 3 * 2, "Advertisements; Intention, Prescription, Acceptance; Acks"


@pytest.mark.sweep(1)
@pytest.mark.parametrize(("t_timeout", "loss"), [(0, 20), (300, 40), (1000, 75)])
def test_success_is_that_of_four_messages(t_timeout: int, loss: int) -> None:
    agreed = block(t_timeout, loss, 400)["agreed"]
    low, high = wilson(agreed, 400)
    assert low - 0.05 <= four_messages(loss / 100, t_timeout) <= high + 0.02


def test_bursts_as_long_as_the_time_out_are_worse() -> None:
    assert block(300, 30, 200)["agreed"] > block(300, 30, 200, 2000)["agreed"] + 20


def test_the_histogram_holds_every_agreement() -> None:
    found = block(300, 30)
    assert sum(count for _, count in found["bins"]) == found["agreed"] > 50
    low = sum(n * count for n, count in found["bins"]) * loss_sessions.BIN_MS
    assert low <= found["agreed_ms"] < low + found["agreed"] * loss_sessions.BIN_MS


# -- models


def test_models_at_their_ends() -> None:
    for t in T_TIMEOUTS:
        for model in (one_message, three_exchanges, four_messages):
            assert model(0, t) == 1 and model(1, t) == 0
    assert [eq2(x, 0) for x in (0, 0.5, 1)] == [0, 0, 0], "as printed"
    assert eq2(0.5, 1000) == 1 - 0.5**10
    assert four_messages(0.1, 0) == pytest.approx(0.9**4)
    assert three_exchanges(0.1, 0) == pytest.approx(0.81**3)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_four_messages_by_counting(n: int) -> None:
    """Of all ways in which the copies of a message and of its answer get lost."""
    loss, pair = 0.3, 0.0
    for ways in product((True, False), repeat=2 * n):
        first, second = ways[:n], ways[n:]
        there = next((k for k, ok in enumerate(first) if ok), None)
        back = there is not None and any(second[: n - there])
        if back:
            pair += (1 - loss) ** sum(ways) * loss ** (2 * n - sum(ways))
    assert four_messages(loss, (n - 1) * 100) == pytest.approx(pair**2)


def test_where_a_share_falls() -> None:
    points = [(0.0, 1.0), (10.0, 0.8), (20.0, 0.4)]
    assert falls(points, 0.9) == 5 and falls(points, 0.6) == 15
    assert falls(points, 0.3) is None and falls([(0.0, 0.0)], 0.9) == 0


# -- the road


def test_a_drive_is_coordinated_or_ends_in_a_stop() -> None:
    good, bad = drive(1000, 0), drive(1000, 100)
    assert (good["agreed"], good["completed"], good["stopped"]) == (1, 1, 0)
    assert (bad["agreed"], bad["completed"], bad["stopped"]) == (0, 0, 1)
    assert good["arrival_s"] < 29.5 and bad["arrival_s"] > 31


def test_who_does_not_agree_moves_over_all_the_same() -> None:
    prescriber = loss_road.Insists(Vehicle(1, 0.0, 0, 8.0, 8.0))
    SimulatedDrive([prescriber])
    prescriber.signal(1)
    prescriber.fallback((1, 1), "no_participants")
    assert prescriber.vehicle.changing and prescriber.vehicle.target_lane == 1


def test_who_never_arrives_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loss_road, "TOO_LATE_S", 30.0)
    with pytest.raises(ExperimentError, match=r"does not arrive: .*'loss': 0"):
        drive(0, 0)


# -- the tables


def test_a_class_of_fig_9_ends_with_its_limit() -> None:
    result = {n: [0] * 5 for n in ("agreed", "completed", "stopped")}
    cell = Cell({}, result | {"arrival_s": [29.0, 29.001, 30.0, 31.0, 31.001]})
    assert classes(50, [cell])["classes"] == [1, 2, 1, 1]


def test_costs_are_of_all_that_was_sent_and_of_the_times_to_agreement() -> None:
    values = {"t_timeout": 0, "loss": 50, "trials": 100}
    result = {"agreed": 40, "sent": 800, "agreed_ms": 8000, "bins": [[1, 30], [3, 8], [9, 2]]}
    (row,) = cost([Cell(values, result)])
    assert (row["messages"], row["mean_ms"], row["q95_ms"]) == (20.0, 200, 400)
