"""Arrival times of a receiver: the clock, the two ways to drive, and the claims."""

from __future__ import annotations

import copy
import sys
from typing import Any

import pytest

from automcm.applications.lane_change import LaneChange
from automcm.applications.vehicle import Late
from automcm_evaluation.arrival import arrival, arrival_claims, sumo
from automcm_evaluation.framework.experiment import Cell, ExperimentError
from automcm_evaluation.sweeps import report, sweep
from automcm_simulation.road.drive import FourVehicles

Json = Any
SMALL: Json = {
    "trials": 2,
    "draws": 1,
    "notices": [],
    "brakes": [3.0],
    "restarts_s": [1.5],
    "restart_gaps": [20.0, 45.0],
    "accelerations": [2.5],
}
USUAL: Json = arrival.Arrival().model_dump(mode="json")
PLACES: Json = {name: USUAL[name] for name in arrival.PLACES}
MODEL: Json = {name: USUAL[name] for name in (*arrival.MODEL, "acceleration")}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Json:
    """The report of a very small sweep."""
    made = arrival.EXPERIMENT
    about = sweep.header(made, "quick", 1, made.set("quick", SMALL))
    folder = tmp_path_factory.mktemp("arrival")
    return report.assemble(made, about, sweep.sweep(made, about, folder, workers=1))


def values(part: str, **more: Json) -> Json:
    return {"part": part, "speed_kmh": 50, "places": PLACES, "model": MODEL} | more


@pytest.mark.parametrize("coordinated", [True, False])
def test_the_clock_runs_from_the_signal_to_the_target(coordinated: bool) -> None:
    """With nobody in the way the receiver drives on: way divided by speed."""
    driven = arrival.drive(values("trials"), (5000.0, 50.0), MODEL, coordinated=coordinated)
    assert driven["arrival_s"] == pytest.approx((260 - 50) / (50 / 3.6), abs=0.002)
    assert driven["hardest"] == 0 and driven["slowest"] == pytest.approx(50 / 3.6, abs=1e-3)
    later = arrival.drive(values("trials"), (5000.0, 20.0), MODEL, coordinated=coordinated)
    assert later["arrival_s"] == pytest.approx((260 - 20) / (50 / 3.6), abs=0.002)


def test_a_trial_is_driven_both_ways_from_the_same_start_and_again_the_same() -> None:
    cell = values("trials", block=0, trials=2)
    first = arrival.run(cell, 7)
    arrival.run(values("one", draws=1, name="notice", tried=[1.0]), 9)
    assert arrival.run(cell, 7) == first
    assert first["signal_m"] != arrival.run(cell, 8)["signal_m"]
    for which in ("with", "without"):
        driven = [
            arrival.drive(cell, draw, MODEL, coordinated=which == "with")["arrival_s"]
            for draw in zip(first["beside_m"], first["signal_m"], strict=True)
        ]
        assert driven == pytest.approx(first[which]["arrival_s"], abs=0.02)


def test_without_coordination_it_stops_and_with_it_hardly_brakes_at_the_lane_change() -> None:
    with_, without = (
        arrival.drive(values("trials"), (6.0, 50.0), MODEL, coordinated=coordinated)
        for coordinated in (True, False)
    )
    assert (with_["completed"], without["completed"]) == (1, 0)
    alone = arrival.drive(values("trials"), (5000.0, 50.0), MODEL, coordinated=True)
    assert alone["completed"] == 0
    assert without["stood_s"] >= MODEL["restart_s"] and without["slowest"] == 0
    assert with_["stood_s"] == 0 and with_["slowest"] > 50 / 3.6 - 20 / 3.6 - 0.5
    assert without["after"] >= 3 and with_["after"] < 0.5 < with_["hardest"]


def test_the_driver_is_the_same_with_and_without(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also with coordination the receiver stops late if the gap is not open."""
    made: list[Json] = []
    on = FourVehicles.on
    monkeypatch.setattr(
        FourVehicles, "on", lambda *args, **more: made.append(on(*args, **more)) or made[-1]
    )
    for coordinated in (True, False):
        arrival.drive(values("trials"), (6.0, 50.0), MODEL, coordinated=coordinated, seed=3)
    (_, with_), (_, without) = ([d.vehicle for d in drive.drivers] for drive in made)
    assert (with_.late, with_.driving) == (without.late, without.driving)
    assert with_.late == Late(**{name: MODEL[name] for name in arrival.MODEL})


def test_with_the_calibrated_baseline_the_paper_s_gains_come_out() -> None:
    settings = arrival.Arrival(draws=2, notices=(0.5,), sumo=False)
    assert settings.restart_gap == FourVehicles().late.restart_gap
    cells = [cell for cell in arrival.cells(settings) if cell.get("name") == "notice"]
    assert len(cells) == 2
    for cell in cells:
        gain, _ = arrival_claims.PAPER[cell["speed_kmh"]]
        assert arrival.run(cell, 1)["gain_s"] == [pytest.approx(gain, abs=0.5)]


@pytest.mark.parametrize(
    ("name", "less", "more"),
    [
        ("restart_gap", 30.0, 80.0),
        ("restart_s", 1.0, 5.0),
        ("brake", 8.0, 2.0),
        ("acceleration", 2.5, 1.0),
    ],
)
def test_each_parameter_of_the_baseline_matters(name: str, less: float, more: float) -> None:
    speed_kmh = 30 if name == "restart_gap" else 50
    cell = values("one", speed_kmh=speed_kmh, draws=1, name=name, tried=[less, more])
    least, most = arrival.run(cell, 1)["gain_s"]
    assert most > least + 1


def test_a_grid_is_of_the_gains_its_parameters_give_each() -> None:
    cell = values("grid", draws=1, brake=2.0, restart_gaps=[45.0, 80.0], restarts_s=[0.0, 5.0])
    (_, long_wait), (wide_gap, _) = arrival.run(cell, 1)["gain_s"]
    for changes, gain in (({"restart_s": 5.0}, long_wait), ({"restart_gap": 80.0}, wide_gap)):
        changed = MODEL | {"brake": 2.0, "restart_s": 0.0} | changes
        one = values("one", draws=1, name="notice", tried=[0.5]) | {"model": changed}
        assert arrival.run(one, 2)["gain_s"] == [gain]


def test_starts_spread_evenly_stay_within_their_ranges() -> None:
    starts = arrival.spread(PLACES, 40)
    beside, signal = ([start[n] for start in starts] for n in (0, 1))
    assert min(beside) >= 5 and max(beside) <= 7.5 and min(signal) >= 45 and max(signal) <= 55
    assert sum(beside) / 40 == pytest.approx(6.25) and sum(signal) / 40 == pytest.approx(50, abs=1)
    assert arrival.drawn(PLACES, 0, 1) == (5, 55)


def test_who_never_arrives_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrival, "TOO_LATE", 1)
    with pytest.raises(ExperimentError, match="does not arrive: 50 km/h"):
        arrival.drive(values("trials"), (6.0, 50.0), MODEL, coordinated=False)


def test_a_summary_by_hand() -> None:
    """Two trials; gains of 4 and 6 s, so a standard error of 1 s."""
    of = {name: [1.0, 2.0] for name in ("stood_s", "slowest", "hardest", "after")}
    with_ = of | {"arrival_s": [28.0, 29.5], "completed": [1, 0]}
    without = of | {"arrival_s": [32.0, 35.5], "completed": [0, 0]}
    result = {"signal_m": [40.0, 60.0], "beside_m": [5, 6], "with": with_, "without": without}
    grid = {"restart_gaps": [45.0], "restarts_s": [1.5], "brake": 3.0}
    cells = [
        Cell(values(part, **more) | {"speed_kmh": speed_kmh}, outcome)
        for speed_kmh in arrival_claims.SPEEDS_KMH
        for part, more, outcome in (("trials", {}, result), ("grid", grid, {"gain_s": [[5.0]]}))
    ]
    found = arrival_claims.summary(cells)
    here = found["speeds"]["30"]
    assert (here["trials"], here["timed_m"], here["gain_s"]) == (2, 210, 5)
    assert (here["low_s"], here["high_s"]) == pytest.approx((5 - 1.96, 5 + 1.96), abs=1e-3)
    assert here["reduction"] == pytest.approx(5 / 33.75, abs=1e-6)
    assert here["ratio"] == pytest.approx(5 / 28.75, abs=1e-6)
    assert here["with"]["lost_s"] == pytest.approx(28.75 - 210 * 3.6 / 30, abs=1e-6)
    assert here["with"]["completed"] == 1 and here["with"]["stopped"] == 2
    assert found["by_29_s"] == {"with": 1, "without": 0, "trials": 2}
    assert found["tried"]["fit"] == 0 and found["tried"]["baselines"] == 1
    assert here["range_s"] == [here["low_s"], here["high_s"]]


def test_no_interval_is_narrower_than_what_the_choice_of_baseline_does(small: Json) -> None:
    """Of gains at 30 and 50 km/h, the first two fit the paper."""
    gains = {"30": [4.6, 5.4, 9.0, 4.6], "50": [6.6, 7.4, 7.0, 9.0]}
    cells = [Cell(c["values"], c["result"]) for c in copy.deepcopy(small["cells"])]
    for cell in cells:
        if cell.values["part"] == "grid":
            cell.values["restarts_s"] = [10.0, 11.0, 12.0, 13.0]
            cell.values["restart_gaps"] = [45.0]
            cell.result["gain_s"] = [gains[str(cell.values["speed_kmh"])]]
    found = arrival_claims.summary([cell for cell in cells if cell.values["part"] != "one"])
    for kmh, (low, high) in (("30", (4.6, 5.4)), ("50", (6.6, 7.4))):
        here = found["speeds"][kmh]
        assert here["range_s"] == [min(low, here["low_s"]), max(high, here["high_s"])]
        assert here["range_s"][0] <= low < high <= here["range_s"][1]


def test_the_ways_of_the_two_readings_by_hand() -> None:
    """5 s are 15 % of 33.3 s, or 15 % of 33.3 s more than that."""
    found = arrival_claims.ways(30, 0.0)
    assert found["reduction"][0] == pytest.approx((100 / 3 - 5) / 3.6 * 30, abs=1e-3)
    assert found["ratio"][0] == pytest.approx(100 / 3 / 3.6 * 30, abs=1e-3)
    shorter = arrival_claims.ways(30, 2.4)
    for reading, (way, low, high) in found.items():
        assert low < way < high and way - shorter[reading][0] == pytest.approx(20)


# -- claims: each verdict can come out


def test_seconds_are_reproduced_only_where_no_baseline_was_fitted(small: Json) -> None:
    found = copy.deepcopy(small["summary"])
    found["speeds"]["30"] |= {"gain_s": 5.2, "range_s": [5.1, 5.3]}
    found["tried"] |= {"least_s": {"30": 1.0}, "greatest_s": {"30": 9.0}}

    def claim() -> tuple[str, str]:
        made = arrival_claims.gain_claim(found, 30)
        return made.verdict, made.why.split(";")[0]

    assert claim() == ("in shape only", "the baseline is fitted to it")
    found["tried"] |= {"least_s": {"30": 4.6}, "greatest_s": {"30": 5.4}}
    assert claim()[0] == "reproduced"
    found["speeds"]["30"] |= {"gain_s": 4.4, "range_s": [4.3, 4.5]}
    assert claim() == ("in shape only", "the fitted baseline misses it")
    found["speeds"]["30"] |= {"gain_s": 0.1, "range_s": [-0.1, 0.3]}
    assert claim()[0] == "not reproduced"


def test_the_order_is_reproduced_only_where_all_baselines_have_it(small: Json) -> None:
    found = copy.deepcopy(small["summary"])
    found["speeds"]["30"] |= {"gain_s": 5.0, "range_s": [4.6, 5.1]}
    found["speeds"]["50"] |= {"gain_s": 7.0, "range_s": [6.9, 7.1]}
    for grows, verdict in ((9, "reproduced"), (8, "in shape only")):
        found["tried"] |= {"grows": grows, "baselines": 9}
        assert arrival_claims.order_claim(found).verdict == verdict
    found["speeds"]["50"]["range_s"] = [5.05, 7.1]
    assert arrival_claims.order_claim(found).verdict == "not reproduced"


def test_the_way_is_reproduced_only_if_one_reading_gives_it_at_both_speeds(small: Json) -> None:
    def verdict(*ranges: tuple[float, float]) -> str:
        found = copy.deepcopy(small["summary"])
        names = [(kmh, reading) for reading in ("reduction", "ratio") for kmh in ("30", "50")]
        for (kmh, reading), (low, high) in zip(names, ranges, strict=True):
            found["ways"][kmh][reading] = [(low + high) / 2, low, high]
        return arrival_claims.way_claim(found, 260.0).verdict

    assert verdict((180, 240), (190, 230), (250, 270), (240, 280)) == "reproduced"
    assert verdict((250, 270), (255, 280), (0, 1), (2, 3)) == "reproduced"
    assert verdict((250, 270), (255, 280), (0, 3), (2, 4)) == "reproduced"
    assert verdict((180, 240), (190, 230), (250, 270), (280, 290)) == "in shape only"
    assert verdict((180, 190), (200, 230), (250, 270), (280, 290)) == "not reproduced"


def test_braking_is_reproduced_if_it_is_little_with_and_a_stop_without(small: Json) -> None:
    def verdict(with_: float, without: float, stopped: int) -> str:
        found = copy.deepcopy(small["summary"])
        for here in found["speeds"].values():
            here["with"]["after"] = with_
            here["without"] |= {"after": without, "stopped": stopped}
        return arrival_claims.braking_claim(found).verdict

    assert verdict(0.4, 8.0, 2) == "reproduced"
    assert verdict(0.4, 8.0, 1) == verdict(0.6, 8.0, 2) == "in shape only"
    assert verdict(8.0, 8.0, 2) == "not reproduced"


def test_all_baselines_are_counted_once(small: Json) -> None:
    """Two of the grid, of which the parameters one at a time have one, and another."""
    tried = small["summary"]["tried"]
    assert tried["baselines"] == 3 and tried["best"]["restart_gap"] == 45
    assert tried["fit"] == 1
    assert tried["least_s"]["30"] < 3.5 < tried["greatest_s"]["30"] < 6


# -- the page


def test_the_page_has_the_figures_of_the_report(small: Json) -> None:
    text = report.page(small)
    for kmh, here in small["summary"]["speeds"].items():
        low, high = here["range_s"]
        assert f"{here['gain_s']:.2f} s, {low:.2f} to {high:.2f} s over the 1 baselines" in text
        assert f"| {kmh} km/h | {here['gain_s']:.2f} | {low:.2f} to {high:.2f} | " in text
        for which in ("with", "without"):
            assert f"| {kmh} km/h, {which} | {here[which]['mean_s']:.2f} |" in text
    assert "Not run: it needs `automcm[sumo]`" in text and "| not run |" in text
    assert "2 of 2 (34% to 100%)" in text


def test_the_page_has_sumo_s_figures_where_they_are(small: Json) -> None:
    found = copy.deepcopy(small)
    of = {"slowest": 2.0, "hardest": 9.0, "collisions": 0}
    arrivals = {"cooperative": 20.5, "forced": 20.25, "prescribed": 21.0}
    for kmh in ("30", "50"):
        found["summary"]["sumo"][kmh] = {
            how: of | {"arrival_s": arrival_s, "lost_s": arrival_s - 18}
            for how, arrival_s in arrivals.items()
        }
    text = arrival.EXPERIMENT.page(found)
    assert "| 30 km/h, cooperative | 20.50 | 2.50 | 2.0 | 9.0 | 0 | -0.50 |" in text
    assert "| 50 km/h, forced | 20.25 | 2.25 | 2.0 | 9.0 | 0 | -0.75 |" in text
    ours = found["summary"]["speeds"]
    for which, theirs in (("with", 3.0), ("without", 2.25)):
        lost = ours["30"][which]["lost_s"], ours["50"][which]["lost_s"]
        assert f"{theirs:.1f} s in SUMO, {lost[0]:.1f} s here; {theirs:.1f} s in SUMO, " in text
        assert f" s in SUMO, {lost[1]:.1f} s here. " in text
    claim = arrival_claims.sumo_claim(found["summary"])
    assert claim.here == "-0.75 s at 30 km/h, -0.75 s at 50 km/h"
    assert "never stops: slowest 2.0 m/s" in claim.why
    found["summary"]["sumo"]["30"]["forced"]["slowest"] = 0.0
    assert "follower stops" in arrival_claims.sumo_claim(found["summary"]).why


def test_the_figures_are_drawn(small: Json) -> None:
    pytest.importorskip("matplotlib", reason="extra automcm[plot]: no figures here")
    drawn = dict(arrival.EXPERIMENT.figures(small))
    assert [plot.get_title() for plot in drawn["arrival"].axes] == [
        f"({letter}) {kmh} km/h: {small['summary']['speeds'][kmh]['gain_s']:.2f} s earlier"
        for letter, kmh in (("a", "30"), ("b", "50"))
    ]
    shown = {text.get_text() for text in drawn["baseline"].axes[1].texts}
    assert shown == {f"{p['gain_s']:.1f}" for p in small["summary"]["grid"]["50"]}


# -- SUMO


def test_without_sumo_the_extra_is_named_before_anything_else_is_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "libsumo", None)
    cells = arrival.cells(arrival.Arrival(trials=2))
    assert [cell["part"] for cell in cells].index("trials") == 6
    with pytest.raises(ExperimentError, match=r"automcm\[sumo\]"):
        arrival.run(cells[0], 1)
    assert not any(c["part"] == "sumo" for c in arrival.cells(arrival.Arrival(sumo=False)))


def test_in_sumo_it_is_prescribed_when_it_is_with_us_and_the_lane_is_changed_then() -> None:
    drive = FourVehicles(vehicles=2, until_s=12).run()
    assert isinstance(drive.drivers[0], LaneChange)
    told = {what.split()[0]: t / 1000 for t, what in drive.drivers[0].story}
    assert told["prescribes"] - told["signals"] == pytest.approx(sumo.DECIDED_S, abs=0.1)
    trial = sumo.Trial(how="prescribed", speed=30 / 3.6, beside_m=5, signal_s=told["signals"])
    slower, moves_s = trial.slower()
    assert slower is not None and moves_s == pytest.approx(told["moves"], abs=0.2)
    assert min(slower.speeds()) == pytest.approx(10 / 3.6)


@pytest.mark.parametrize(
    ("name", "value"), [("brakes", []), ("brakes", [0]), ("restart_gap", 101), ("trials", 1)]
)
def test_a_setting_out_of_range_is_named(name: str, value: Json) -> None:
    with pytest.raises(ExperimentError, match=name):
        arrival.EXPERIMENT.set("quick", {name: value})
