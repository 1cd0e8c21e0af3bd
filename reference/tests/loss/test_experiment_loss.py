"""The experiment on packet loss: sessions, drives, models, verdicts."""

from __future__ import annotations

from copy import deepcopy
from itertools import product
from typing import Any

import pytest

from automcm.applications.vehicle import Vehicle
from automcm.links.simulated_radio import Channel
from automcm_evaluation.framework.experiment import Cell, ExperimentError
from automcm_evaluation.framework.intervals import wilson
from automcm_evaluation.loss import loss_page, loss_road, loss_sessions
from automcm_evaluation.loss.loss import FINE, TENS, Loss, cells
from automcm_evaluation.loss.loss_tables import (
    T_TIMEOUTS,
    claims,
    eq2,
    falls,
    four_messages,
    one_message,
    summary,
    three_exchanges,
)
from automcm_evaluation.sweeps import report, sweep
from automcm_evaluation.sweeps.catalogue import experiment
from automcm_simulation.road.drive import SimulatedDrive

Json = Any
SMALL = Loss(
    road=1,
    road_losses=(0, 100),
    sessions=20,
    fine=10,
    bursts_ms=(1000,),
    in_bursts=10,
    timeouts=(0, 300),
    cost_losses=(20,),
    cost=20,
    udp=0,
)


def block(t_timeout: int, loss: int, trials: int = 100, burst_ms: int = 0) -> Json:
    values = {"t_timeout": t_timeout, "loss": loss, "trials": trials, "burst_ms": burst_ms}
    return loss_sessions.block(values, 7)


def drive(t_timeout: int, loss: int, seed: int = 3) -> Json:
    values = {"t_timeout": t_timeout, "loss": loss, "target_m": 260.0}
    return loss_road.drive(values, seed, beside_m=5.0, signal_m=50.0)


@pytest.fixture(scope="module")
def made() -> Json:
    """A whole report of few trials."""
    one = experiment("loss")
    about = sweep.header(one, "quick", 1, SMALL)
    ran = [Cell(values, sweep.run_cell("loss", values, 1)) for values in cells(SMALL)]
    return report.assemble(one, about, ran)


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


# -- the whole


@pytest.mark.slow
def test_a_cell_gives_the_same_again(made: Json) -> None:
    for n in (0, 40, -1):
        cell = made["cells"][n]
        assert sweep.run_cell("loss", cell["values"], 1) == cell["result"]


def test_each_loss_and_time_out_of_the_paper_is_there(made: Json) -> None:
    for t in T_TIMEOUTS:
        losses = [p["loss"] for p in made["summary"]["points"][str(t)]]
        assert losses == sorted({*TENS, *FINE[t]})
        assert all(
            p["trials"] == (20 if p["loss"] % 10 == 0 else 10)
            for p in made["summary"]["points"][str(t)]
        )
    assert len(cells(Loss(udp=20))) == len(cells(Loss(udp=0))) + 9


def test_the_page_has_the_numbers_of_the_report(made: Json) -> None:
    text = loss_page.page(made)
    for t in T_TIMEOUTS:
        for p in made["summary"]["points"][str(t)]:
            if p["loss"] in TENS:
                assert f"| {p['loss']}% | {p['agreed']} of {p['trials']} |" in text
    assert "Not run (`--set udp=20`)." in text
    changed = deepcopy(made)
    of = {"t_timeout": 0, "loss": 30, "trials": 9, "agreed": 7, "latest_ms": 12}
    changed["summary"]["udp"] = [of | {"share": 7 / 9, "low": 0.4, "high": 0.9}]
    assert "| 0 s | 30% | 7 of 9 | 40% to 90% |" in loss_page.page(changed)


# -- verdicts


def verdicts(made: Json) -> dict[str, str]:
    return {claim.claim.split(" ")[0]: claim.verdict for claim in claims(made)}


def road(made: Json, shares: dict[int, list[tuple[int, float]]]) -> Json:
    """The report with these shares of late drives."""
    changed = deepcopy(made)
    changed["summary"]["road"] = {
        str(t): [
            {"loss": x, "trials": 100, "classes": [100 - s, 0, 0, s], "completed": 100 - s}
            for x, s in (*some, (20, 0))
        ]
        for t, some in shares.items()
    }
    return changed


def test_rising_where_the_papers_rise_is_reproduced(made: Json) -> None:
    late = {t: [(0, 0), (k, 20), (k + 20, 100)] for t, k in ((0, 10), (1000, 60), (2000, 70))}
    assert verdicts(road(made, late))["arrival"] == "reproduced"
    late = {t: [(0, 0), (k, 0), (k + 10, 100)] for t, k in ((0, 30), (1000, 70), (2000, 85))}
    assert verdicts(road(made, late))["arrival"] == "in shape only"
    late = {t: [(0, 0), (k, 0), (k + 10, 100)] for t, k in ((0, 30), (1000, 20), (2000, 85))}
    assert verdicts(road(made, late))["arrival"] == "not reproduced"


def points(made: Json, shares: dict[int, float], burst: float = 1.0, trials: int = 10_000) -> Json:
    """The report with one share for all losses of a time-out, and one for all bursts."""
    changed = deepcopy(made)
    s = changed["summary"]
    for some, share in [(s["points"][str(t)], share) for t, share in shares.items()] + [
        (some, burst) for some in s["bursts"]["1000"].values()
    ]:
        low, high = wilson(round(share * trials), trials)
        for p in some:
            p |= {"share": share, "low": low, "high": high, "agreed": 1, "trials": trials}
    return changed


def test_a_longer_time_out_must_not_be_worse(made: Json) -> None:
    for second, third, verdict in ((0.7, 0.9, "reproduced"), (0.9, 0.7, "not reproduced")):
        _, claim, *_ = claims(points(made, {0: 0.5, 1000: second, 2000: third}))
        assert claim.claim == "the longest time-out tolerates the most loss"
        assert claim.verdict == verdict


@pytest.mark.parametrize(
    ("share", "burst", "verdict"),
    [
        (0.999, 0.999, "reproduced"),
        (0.999, 0.75, "in shape only"),
        (0.95, 0.95, "in shape only"),
        (0.5, 0.999, "not reproduced"),
    ],
)
def test_robust_is_99_per_cent_at_a_loss_of_20_also_in_bursts(
    made: Json, share: float, burst: float, verdict: str
) -> None:
    assert verdicts(points(made, {1000: share, 2000: share}, burst))["robust"] == verdict


def test_agreed_is_not_completed(made: Json) -> None:
    """What is given as robust has the completed drives beside it, even and in bursts."""
    changed = deepcopy(made)
    row = {"loss": 20, "trials": 60, "agreed": 51, "completed": 13, "stopped": 32}
    changed["summary"]["road_bursts"]["1000"]["2000"] |= row
    claim = next(claim for claim in claims(changed) if claim.claim.startswith("robust"))
    assert "bursts of 1 s: " in claim.here and "13 of 60 drives complete (2 s)" in claim.here
    assert "| 2 s | bursts of 1 s | 60 | 51 | 13 | 32 |" in loss_page.page(changed)


def test_completed_drives_have_their_own_knee_and_count_for_the_order(made: Json) -> None:
    times = {"arrival_s": [28.0] * 60, "agreed": [1] * 60, "stopped": [0] * 60}

    def fewer(t: int) -> Json:
        result = times | {"completed": [0] * 60}
        return summarised(made, Cell({"part": "road", "t_timeout": t, "loss": 50}, result))

    found = fewer(2000)
    assert found["knees"]["2000"]["completed"]["knee"] < 50
    row = next(row for row in found["road"]["2000"] if row["loss"] == 50)
    assert (row["agreed"], row["completed"]) == (60, 0)
    changed = points(made, {0: 0.5, 1000: 0.7, 2000: 0.9})
    for t, completed in (("1000", 60), ("2000", 0)):
        for row in changed["summary"]["road"][t]:
            row |= {"trials": 60, "completed": completed}
    _, claim, *_ = claims(changed)
    assert claim.claim.startswith("the longest") and claim.verdict == "not reproduced"


def test_eq_2_explains_nothing_unless_it_has_the_papers_knees(made: Json) -> None:
    assert verdicts(made)["Eq."] == "not reproduced"
    changed = deepcopy(made)
    for t, knee in ((0, 10), (1000, 60), (2000, 70)):
        changed["summary"]["knees"][str(t)]["eq2"] = {"knee": knee, "half": knee + 10}
    assert verdicts(changed)["Eq."] == "reproduced"


def test_a_summary_is_of_its_cells_alone(made: Json) -> None:
    turned = made | {"cells": made["cells"][::-1]}
    assert summarised(turned)["points"] == made["summary"]["points"]


def summarised(made: Json, *more: Cell) -> Json:
    """The summary of the report's cells and some more."""
    return summary([*(Cell(cell["values"], cell["result"]) for cell in made["cells"]), *more])


def test_costs_are_of_all_that_was_sent_and_of_the_times_to_agreement(made: Json) -> None:
    values = {"part": "cost", "loss": 50, "burst_ms": 0, "block": 0, "trials": 100}
    few = {"agreed": 40, "sent": 800, "agreed_ms": 8000, "bins": [[1, 30], [3, 8], [9, 2]]}
    all_ = {"agreed": 100, "sent": 900, "agreed_ms": 50_000, "bins": [[5, 100]]}
    of = ((0, few), (700, all_), (3000, all_))
    found = summarised(made, *(Cell(values | {"t_timeout": t}, result) for t, result in of))
    first = next(row for row in found["cost"] if row["loss"] == 50)
    assert (first["messages"], first["mean_ms"], first["q95_ms"]) == (20.0, 200, 400)
    smallest = next(row for row in found["smallest"] if row["loss"] == 50)
    assert (smallest["measured"], smallest["longest"]) == (700, 3000)


def test_a_class_of_fig_9_ends_with_its_limit(made: Json) -> None:
    times = [29.0, 29.001, 30.0, 31.0, 31.001]
    result = {"arrival_s": times} | {n: [0] * 5 for n in ("agreed", "completed", "stopped")}
    found = summarised(made, Cell({"part": "road", "t_timeout": 0, "loss": 50}, result))
    row = next(row for row in found["road"]["0"] if row["loss"] == 50)
    assert row["classes"] == [1, 2, 1, 1]
