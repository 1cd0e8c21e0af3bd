"""Hazards under faults: their measurement, that it can fail, and the page."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from automcm.links.simulated_radio import Channel
from automcm.service.service import McService
from automcm_evaluation.framework.experiment import Cell
from automcm_evaluation.safety import safety, safety_tables
from automcm_evaluation.safety.ablations import ABLATIONS, BY_NAME, PARAMETERS, WHOLE, Ablation
from automcm_evaluation.safety.faults import Injected
from automcm_evaluation.sweeps.sweep import canonical
from automcm_simulation.road.hazard_measures import Watched, bound_ms
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.log_format.reader import read
from automcm_spec.model_checking import models
from automcm_spec.vocabulary.messages import Session
from automcm_spec.vocabulary.parameters import Parameters
from automcm_spec.vocabulary.rules import RULES as RULE_IDS
from automcm_traces.system.properties import judge

B = 1540
ROOT = Path(__file__).resolve().parents[3]


def simulate(
    faults: list[Injected],
    ablation: Ablation = WHOLE,
    *,
    loss: float = 0.0,
    maneuver_ms: int = 9000,
    seed: int = 1,
    logs: Path | None = None,
    prepare: Any = lambda watched: None,
) -> Watched:
    """A maneuver asked for at 500 ms; both act from about 2.7 s on."""
    channel = Channel(loss=loss, duplicate=0.1)
    watched = Watched(seed=seed, channel=channel, logs=logs)
    prepare(watched)
    with ablation.applied():
        safety.simulate(watched, ablation.parameters, faults, maneuver_ms)
    return watched


def lengths(found: Watched) -> list[tuple[str, int]]:
    return [(hazard.excuse, hazard.length_ms) for hazard in found.over()]


# -- the bound


def test_t_2_the_bound_and_what_it_supposes() -> None:
    assert bound_ms(Parameters(), 40) == B
    assert bound_ms(Parameters(t_cam_loss=1100), 0) == 1100
    for parameters, delay in (
        (Parameters(), 50),
        (Parameters(), -1),
        (Parameters(t_cam=40), 40),
        (Parameters(t_cam=1000, t_cam_loss=1040), 40),
    ):
        with pytest.raises(ValueError, match=r"delay_ms|t_cam"):
            bound_ms(parameters, delay)


@pytest.mark.sweep(2)
@pytest.mark.parametrize(
    ("kind", "loss"),
    [("target restarts", 0.0), ("target aborts", 0.6), ("cut forth", 0.4), ("cut both ways", 0.2)],
)
def test_t_2_hazards_and_bound_are_those_that_the_logs_are_judged_by(
    kind: str, loss: float, tmp_path: Path
) -> None:
    seen = 0
    for seed in range(3):
        logs = tmp_path / str(seed)
        logs.mkdir()
        fault = Injected(kind, 4000 + 37 * seed, 8000)
        found = simulate([fault], loss=loss, seed=seed, logs=logs)
        judged = judge([read(path) for path in sorted(logs.iterdir())])
        theirs = [h for h in judged.hazards if h.length is None or h.length.best > 0]
        excuses = {"aborts": "abort", "loses the CAMs": "cam_loss", "restarts": "restart"}
        assert [
            (next(e for text, e in excuses.items() if text in h.fault), h.length and h.length.best)
            for h in theirs
        ] == lengths(found)
        for h in theirs:
            assert h.bound is not None and h.excused
            # the judge knows of the delay only that it is below half of t_resend
            assert h.bound.ms - 50 == bound_ms(Parameters(), 40) - 40
            assert h.outcome == "within"
        seen += len(theirs)
    assert seen


# -- that it can fail

RESTART, CUT = Injected("target restarts", 4000, 0), Injected("cut forth", 4000, 9000)
SECOND = Injected("second prescriber", 4000, 4000)
CRASH = Injected("target crashes", 4000, 9000)


@pytest.mark.parametrize(
    ("faults", "protocol", "maneuver_ms", "excuse", "least", "most"),
    [
        ([], WHOLE.name, 60_000, None, 0, 0),
        ([], "lease from the Acceptance", 60_000, "", 1, 199),
        ([RESTART], WHOLE.name, 60_000, "restart", 1401, B),
        ([RESTART], "plain CAMs count", 60_000, "restart", 8001, 9999),  # until the lease
        ([RESTART], "no CAM-loss fallback", 9000, "restart", B + 1, 60_000),
        ([CUT], WHOLE.name, 9000, "cam_loss", 0, 40),  # the Cancel ends it at once
        ([CUT], "silent CAM-loss fallback", 9000, "cam_loss", 1401, B),
        ([CUT], "no CAM-loss fallback", 9000, None, 0, 0),
        ([SECOND], WHOLE.name, 9000, None, 0, 0),
        ([SECOND], "no busy refusal", 9000, "", 1001, 60_000),  # it acts on, in the other session
        ([Injected("target crashes", 4000, 5000)], WHOLE.name, 9000, "crash", 1401, B),
        ([Injected("prescriber crashes", 4000, 5000)], WHOLE.name, 9000, None, 0, 0),
        ([CRASH, Injected("prescriber crashes", 4500, 9000)], WHOLE.name, 9000, "crash", 500, 500),
    ],
)
def test_s_5_act_2_act_5_neg_4_a_mechanism_ends_or_prevents_a_hazard(
    faults: list[Injected],
    protocol: str,
    maneuver_ms: int,
    excuse: str | None,
    least: int,
    most: int,
) -> None:
    found = lengths(simulate(faults, BY_NAME[protocol], maneuver_ms=maneuver_ms))
    assert [name for name, _ in found] == ([] if excuse is None else [excuse])
    assert all(least <= length <= most for _, length in found)


@pytest.mark.parametrize(
    ("without", "drives", "text"),
    [("plain CAMs count", 4, "T-2: longer"), ("lease from the Acceptance", 10, "S-5: without")],
)
def test_what_was_proved_and_does_not_hold_is_told_with_its_seed(
    without: str, drives: int, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = {"part": "faults", "fault": "target restarts", "loss": 0.4, "drives": drives}
    values["delay_ms"] = 40
    fine = safety.run(values, 1)
    assert fine["wrong"] == [] and fine["with_hazard"] > 1
    whole = replace(BY_NAME[without], name=WHOLE.name)
    monkeypatch.setitem(BY_NAME, WHOLE.name, whole)
    bad = safety.run(values, 1)
    (first, *_) = safety_tables._broken([Cell(values, bad)])
    assert first.startswith(text)
    one = bad["wrong"][0]
    assert f"safety.drive({canonical(values)}, {one['seed']})" in first
    again = safety.drive(values, one["seed"])
    assert (one["excuse"], one["ms"]) in lengths(again)
    assert safety_tables._broken([Cell(values, fine)]) == []


def test_a_station_that_never_comes_free_is_told() -> None:
    assert simulate([], BY_NAME["no lease"], maneuver_ms=600_000).idle is False
    assert simulate([], maneuver_ms=600_000).idle


# -- what is taken away


def test_every_ablation_names_what_there_is() -> None:
    assert len(BY_NAME) == len(ABLATIONS) + 1
    assert {ablation.rule for ablation in ABLATIONS} <= {*RULE_IDS}
    assert {ablation.model for ablation in ABLATIONS} <= {model.cfg for model in models.load()}


def test_each_ablation_is_applied_and_taken_back() -> None:
    right = safety.outcome(simulate([], loss=0.3), B)
    for ablation in ABLATIONS:
        with ablation.applied():  # an edit that changes no function is an error
            assert ablation.fault and (ablation.fault.edits or ablation.parameters != PARAMETERS)
    assert safety.outcome(simulate([], loss=0.3), B) == right


# -- faults


def test_whoever_is_hit_drives_on_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[int, str]] = []

    def fallback(self: Straight, session: Session, reason: str) -> None:
        assert isinstance(self.service, McService)
        told.append((self.service.station_id, reason))

    monkeypatch.setattr(Straight, "fallback", fallback)
    for who, station_id in (("prescriber", 1001), ("target", 2002)):
        for what in ("abort", "restart"):
            told.clear()
            simulate([Injected(f"{who} {what}s", 4000, 5000)])
            assert (station_id, what) in told
        told.clear()
        simulate([Injected(f"{who} crashes", 4000, 5000)])
        assert (station_id, "crash") in told


# -- the tables


def test_what_is_worse_without_a_mechanism() -> None:
    whole = {"drives": 100, "with_hazard": 20, "agreed": 90, "completed": 80, "in_vain": 2}
    whole |= {"unexcused": 0, "beyond": 0, "stuck": 0}
    assert safety_tables.shows(dict(whole), whole) == []
    for changes, text in (
        ({"unexcused": 1}, "S-5"),
        ({"beyond": 1}, "T-2"),
        ({"stuck": 1}, "L-1"),
        ({"with_hazard": 50}, "more hazards"),
        ({"agreed": 60}, "fewer agreements"),
        ({"in_vain": 30}, "takes for failed"),
    ):
        (found,) = safety_tables.shows(whole | changes, whole)
        assert text in found
    assert safety_tables.shows(whole | {"with_hazard": 25, "agreed": 85}, whole) == []


def test_a_fault_class_beyond_its_bound_and_a_run_without_end_are_broken() -> None:
    path = ROOT / "docs" / "evaluation" / "safety" / "results.json"
    cells = [Cell(**cell) for cell in json.loads(path.read_bytes())["cells"]]
    for cell in cells:
        if (cell.values["part"], cell.values.get("fault")) == ("classes", "target aborts"):
            cell.result["lengths"] = {"abort": [41]}
    cells[0].result["stuck"] = 2
    broken = safety_tables.summary(cells)["broken"]
    assert [text[:10] for text in broken] == ["T-1: 2 run", "T-2: targe"]
    assert "41 ms, D = 40 ms" in broken[1]
