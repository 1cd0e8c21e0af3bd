"""The experiment on the radio channel: its cells, its figures and its page."""

from __future__ import annotations

from typing import Any

import pytest

from automcm_evaluation.radio.radio import Over, cells
from automcm_evaluation.radio.radio_tables import MODELS, arrivals, bursts, claims, largest
from automcm_evaluation.radio.radio_traffic import Measured, Row, ns3_measured, pooled
from automcm_evaluation.sweeps import report, sweep
from automcm_evaluation.sweeps.catalogue import experiment

Json = Any
SMALL = Over(
    fit_seeds=1,
    distances=(25, 400),
    loads=(0.0,),
    sessions=4,
    road_distances=(25,),
    road=1,
    crowds=(20,),
    crowd_ms=3000,
    sizes=(159,),
)


@pytest.fixture(scope="module")
def made() -> Json:
    """A report of few cells; the fit is that of ns-3 with itself."""
    one = experiment("radio")
    own = {m.traffic.name: m for m in ns3_measured()}
    found = []
    for values in cells(SMALL):
        if values["part"] == "fit":
            same = own[values["traffic"]].model_dump(mode="json")
            result = {"busy": same["busy"], "rows": same["rows"]}
        else:
            result = sweep.run_cell("radio", values, 1)
        found.append(sweep.CELL.validate_python({"values": values, "result": result}))
    return report.assemble(one, sweep.header(one, "quick", 1, SMALL), found)


@pytest.mark.slow
def test_near_sessions_agree_and_the_models_expect_it(made: Json) -> None:
    points = {(p["t_timeout"], p["distance_m"]): p for p in made["summary"]["sessions"]}
    assert points[2000, 25]["agreed"] == points[2000, 25]["trials"] == 4
    assert all(points[2000, 25][name] > 0.99 for name in MODELS)
    assert points[0, 400]["loss"] > 0.4 > points[0, 400]["three_even"]


@pytest.mark.slow
def test_equal_measurements_do_not_differ_and_a_moved_one_does(made: Json) -> None:
    for fit in made["summary"]["fit"]:
        assert set(fit["largest"].values()) <= {0.0, None}
    assert made["claims"][0]["verdict"] == "beyond the paper"
    moved = dict(made["summary"])
    moved["fit"] = [fit | {"largest": dict(fit["largest"], again=3.1)} for fit in moved["fit"]]
    assert claims({"summary": moved})[0].verdict == "not reproduced"


def test_differences_are_in_points_and_rare_losses_are_not_compared() -> None:
    ns3 = next(m for m in ns3_measured() if m.traffic.name == "100 per km")
    rows = [row.model_copy(update={"arrived": row.arrived + row.frames // 50}) for row in ns3.rows]
    pairs = [(row["ns3"], row["table"]) for row in arrivals(ns3, rows)]
    assert largest(pairs) == pytest.approx(2, abs=0.02) and largest([]) is None
    assert [band["distance_m"] for band in bursts(ns3, ns3.rows)] == [25, 125, 225, 325, 425]
    few = [row.model_copy(update={"runs": 10}) for row in ns3.rows]
    rare = ns3.model_copy(update={"rows": few})
    assert bursts(rare, ns3.rows) == []


def test_runs_of_one_traffic_are_added() -> None:
    one = ns3_measured()[0]
    both = pooled([one, one])
    assert both.busy == one.busy and both.rows[0].frames == 2 * one.rows[0].frames
    assert isinstance(both, Measured) and isinstance(both.rows[0], Row)


@pytest.mark.slow
def test_the_page_has_every_part(made: Json) -> None:
    text = report.page(made)
    for part in ("two jams", "| 2 s | 0 | 400 |", "| 20 | 159 | yes |", "| 0 s | 25 | 1 |"):
        assert part in text, part
    assert "None" not in text and "nan" not in text


@pytest.mark.slow
def test_the_crowd_without_control_sends_every_cam(made: Json) -> None:
    crowds = {row["control"]: row for row in made["summary"]["crowds"]}
    assert crowds[False]["per_s"] == pytest.approx(10, abs=0.05)
    assert crowds[True]["per_s"] == pytest.approx(10, abs=0.05)
    assert 0 < crowds[False]["busy"] < 0.1 and crowds[False]["arrived"] > 0.95
