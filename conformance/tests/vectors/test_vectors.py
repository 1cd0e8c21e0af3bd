"""The test vectors: they are as generated; errors for a bad file and for a difference."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import jsonschema
import mpmath
import pytest
import shapely
from cli_stage import automcm

from automcm_cli.reference import vector_adapter
from automcm_conformance.adapter.kit_paths import VECTORS
from automcm_conformance.vectors import vectors
from automcm_maintenance.code_mutation import faults
from automcm_maintenance.exact_vectors import exact_kernels

CASES = [case for path in vectors.paths() for case in vectors.load(path)]


SCHEMA = jsonschema.Draft202012Validator(json.loads((VECTORS / vectors.SCHEMA).read_text()))


def test_the_schema_is_one() -> None:
    SCHEMA.check_schema(SCHEMA.schema)


@pytest.mark.parametrize("path", vectors.paths(), ids=lambda path: path.stem)
def test_a_file_has_the_form_of_the_schema(path: Path) -> None:
    file = json.loads(path.read_text())
    assert SCHEMA.is_valid(file) and file["kernel"] == path.stem
    ids = [vector["id"] for vector in file["vectors"]]
    assert len(set(ids)) == len(ids) and all(id_.startswith(path.stem + "-") for id_ in ids)
    assert {vector["bug"] for vector in file["vectors"]} == set(file["bugs"])


@pytest.mark.parametrize(
    "change",
    [
        lambda f: f.update(kernel="guess"),
        lambda f: f.update(kernel="thin"),
        lambda f: f.update(more=1),
        lambda f: f["vectors"][2].pop("bug"),
        lambda f: f["vectors"][0].update(more=1),
        lambda f: f["vectors"][0]["inputs"].update(loss="a"),
        lambda f: f["vectors"][0]["inputs"].update(los=1),
        lambda f: f["vectors"][0]["expected"].pop("session"),
        lambda f: f["vectors"][1].update(id="Once"),
    ],
)
def test_the_schema_refuses_a_bad_file(change: Callable[[Any], object]) -> None:
    file = json.loads((VECTORS / "success.json").read_text())
    assert SCHEMA.is_valid(file)
    change(file)
    assert not SCHEMA.is_valid(file)


def test_the_folder_holds_nothing_else() -> None:
    found = {path for path in VECTORS.iterdir() if path.suffix == ".json"}
    assert found == {*vectors.paths(), VECTORS / vectors.SCHEMA}


# -- the exact implementation against others


def test_figures_of_the_paper_and_of_the_design() -> None:
    loss = {(0, 0.1): 53, (1000, 0.5): 88, (1000, 0.6): 62}
    loss |= {(2000, 0.6): 92, (2000, 0.7): 64, (2000, 0.8): 19}
    for (t_timeout, share), per_cent in loss.items():
        given = {"t_timeout": t_timeout, "t_resend": 100, "loss": share}
        assert round(100 * exact_kernels.call("success", given)["session"]) == per_cent
    t = next(case for case in CASES if case.id == "prescribe-thirty").expected["t"]
    assert min(abs(when - (2 + 3.6)) for when in t) < 1e-9


def test_root_against_mpmath() -> None:
    draw = random.Random(1)
    with mpmath.workdps(80):
        for _ in range(200):
            value = Fraction(draw.randrange(10**9), draw.randrange(1, 10**6))
            right = mpmath.sqrt(mpmath.mpf(value.numerator) / value.denominator)
            mine = exact_kernels.root(value)
            assert (
                abs(mpmath.mpf(mine.numerator) / mine.denominator - right) < mpmath.mpf(10) ** -50
            )
    assert exact_kernels.root(Fraction(9, 4)) == Fraction(3, 2)


def test_inside_against_shapely() -> None:
    draw = random.Random(2)
    zone = [(0, 0), (40, 0), (40, 20), (20, 20), (20, 10), (0, 10)]
    polygon = shapely.Polygon(zone)
    corners = [exact_kernels.place(each) for each in zone]
    for _ in range(500):
        point = draw.randrange(-5, 46), draw.randrange(-5, 26)
        mine = exact_kernels.inside(corners, exact_kernels.place(point))
        assert mine == polygon.covers(shapely.Point(point)), point


def test_closest_against_a_fine_grid() -> None:
    for case in CASES:
        if case.kernel != "collide" or not case.expected.get("approach"):
            continue
        a, b = (exact_kernels.trajectory(case.inputs[name]) for name in "ab")
        grid = exact_kernels.common(a, b)
        least = case.expected["approach"]["distance"]
        for n in range(101):
            when = grid[0] + (grid[-1] - grid[0]) * Fraction(n, 100)
            assert float(exact_kernels.distance(a.at(when), b.at(when))) >= least - 1e-9


# -- comparison


def of(id_: str) -> vectors.Case:
    return next(case for case in CASES if case.id == id_)


@pytest.mark.parametrize(
    ("id_", "got", "says"),
    [
        ("success-once", None, "outputs: expected"),
        ("success-once", {"sendings": 1}, "outputs: expected"),
        ("success-no-resend", {"sendings": 1}, "error: expected for t_resend, got none"),
        ("success-no-resend", {"error": "t_resend"}, "error: expected for t_resend, got none"),
        ("success-no-resend", {"error": {"name": "loss"}}, "error: expected t_resend, got loss"),
        (
            "convert-negative-speed",
            {"error": {"name": "speed", "index": 1}},
            "error: expected speed[2], got speed[1]",
        ),
        ("success-once", {"error": {"name": "loss"}}, "error: expected none"),
        ("thin-one-byte-short", {"kept": "all"}, "kept: expected indices"),
        ("thin-slows-down", {"kept": [0, 8, 7, 17]}, "kept: expected ascending indices"),
        ("thin-slows-down", {"kept": [0, 1, 2, 3, 4, 7, 17]}, "kept: expected at most 6 points"),
        ("thin-slows-down", {"kept": [0, 7, 10]}, "kept: [17] must be kept"),
        ("thin-slows-down", {"kept": [0, 7, 17, 18]}, "kept: not indices"),
        ("thin-slows-down", {"kept": [0, 6, 17]}, "kept: at index 6 the speed differs by 5.45"),
        ("thin-arc", {"kept": [0, 4, 8, 12, 16, 20, 24, 28, 30]}, "kept: at index 1 the position"),
        ("thin-slows-down", {"kept": [0, 5, 7, 17]}, ""),
        ("thin-one-byte-short", {"kept": [0, 7]}, ""),
        ("prescribe-even", {"t": [0]}, "outputs: not a motion"),
        ("prescribe-even", {"t": [0, 0], "xy": [[0, 0], [1, 0]]}, "t: expected ascending times"),
        ("prescribe-even", {"t": [0, 9], "xy": [[0, 0], [1, 0]]}, "t: expected times from"),
        ("prescribe-even", {"t": [0, 20], "xy": [[0, 0], [180, 0]]}, "xy: expected"),
    ],
)
def test_what_a_difference_says(id_: str, got: Any, says: str) -> None:
    problem = vectors.difference(of(id_), got)
    assert problem.startswith(says) and bool(problem) == bool(says)


def test_within_the_tolerance_and_beyond_it() -> None:
    case = of("convert-slower")
    near = json.loads(json.dumps(case.expected))
    near["t"][2] += 0.5 * case.tolerance["t"]
    assert vectors.difference(case, near) == ""
    near["t"][2] += case.tolerance["t"]
    assert vectors.difference(case, near).startswith("t[2]: expected")
    near["t"][2] = float("nan")
    assert vectors.difference(case, near).startswith("t[2]: expected")
    assert vectors.difference(case, case.expected | {"stopped": 0}).startswith("stopped: expected")


def test_samples_of_a_motion_are_free() -> None:
    case = of("prescribe-even")
    t, xy = case.expected["t"], case.expected["xy"]
    middle = [(a + b) / 2 for a, b in zip(xy[1], xy[2], strict=True)]
    more = {
        "t": [t[0] - 1, *t[:2], (t[1] + t[2]) / 2, *t[2:], t[-1] + 1],
        "xy": [[-10.0, 0.0], *xy[:2], middle, *xy[2:], [190.0, 0.0]],
        "stopped": True,
    }
    assert vectors.difference(case, more) == ""


def test_an_implementation_that_falls_over_has_failed() -> None:
    def call(kernel: str, inputs: Any) -> Any:
        inputs.clear()
        raise ZeroDivisionError("by 0")

    [result] = vectors.check(call, [of("success-once")])
    assert result.problem == "raised ZeroDivisionError: by 0" and of("success-once").inputs


# -- the command


def test_the_command_agrees_with_the_reference(tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    answer = automcm("vectors", "check", "--json", report)
    assert answer.exit_code == 0, answer.output
    rows = json.loads(report.read_text())["vectors"]
    assert [row["id"] for row in rows] == [case.id for case in CASES]
    assert all(row.keys() == {"id", "kernel", "ok"} and row["ok"] for row in rows)
    assert all(kernel in answer.output for kernel in vectors.KERNELS)


def test_the_command_takes_one_kernel() -> None:
    answer = automcm("vectors", "check", "--kernel", "success", "--json", "-")
    rows = json.loads(answer.output)["vectors"]
    assert answer.exit_code == 0 and {row["kernel"] for row in rows} == {"success"}
    answer = automcm("vectors", "check", "--kernel", "sucess")
    assert answer.exit_code == 2 and "success" in answer.output


def test_the_command_shows_what_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vector_adapter, "call", exact_kernels.call)
    with faults.put(faults.load("vectors")["success/no-first-sending"]):
        _shows_what_fails()


def _shows_what_fails() -> None:
    answer = automcm("vectors", "check", "--kernel", "success")
    assert answer.exit_code == 1
    case = of("success-once")
    for text in (case.id, case.purpose, case.bug, "sendings: expected 1, got 0"):
        assert text in answer.output
    answer = automcm("vectors", "check", "--kernel", "success", "--json", "-")
    assert answer.exit_code == 1 and not json.loads(answer.output)["vectors"][0]["ok"]
