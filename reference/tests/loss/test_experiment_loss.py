"""The experiment on packet loss: a session, the models, a drive without end."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest

from automcm_evaluation.framework.experiment import Cell
from automcm_evaluation.loss import loss_sessions, loss_tables
from automcm_simulation.road.simulation import Simulation

Json = Any


# -- sessions


def test_a_session_without_loss_takes_the_window_and_what_is_sent_in_it() -> None:
    found = loss_sessions.session(Simulation(seed=1), 1000)
    assert found.agreed and 1100 <= found.after_ms <= 1300
    assert found.sent == 11 + 3 * 2, "Advertisements; Intention, Prescription, Acceptance; Acks"


# -- models


def test_models_at_their_ends() -> None:
    for t in loss_tables.T_TIMEOUTS:
        for model in (
            loss_tables.one_message,
            loss_tables.three_exchanges,
            loss_tables.four_messages,
        ):
            assert model(0, t) == 1 and model(1, t) == 0
    assert [loss_tables.eq2(x, 0) for x in (0, 0.5, 1)] == [0, 0, 0], "as printed"
    assert loss_tables.eq2(0.5, 1000) == 1 - 0.5**10
    assert loss_tables.four_messages(0.1, 0) == pytest.approx(0.9**4)
    assert loss_tables.three_exchanges(0.1, 0) == pytest.approx(0.81**3)


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
    assert loss_tables.four_messages(loss, (n - 1) * 100) == pytest.approx(pair**2)


# -- the road


# -- the tables


def test_a_class_of_fig_9_ends_with_its_limit() -> None:
    result = {n: [0] * 5 for n in ("agreed", "completed", "stopped")}
    cell = Cell({}, result | {"arrival_s": [29.0, 29.001, 30.0, 31.0, 31.001]})
    assert loss_tables.classes([cell])["classes"] == [1, 2, 1, 1]
