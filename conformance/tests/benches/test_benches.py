"""``automcm bench``: ratios to a baseline of the same run, bars, and what is left out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_stage import automcm

from automcm.kernels.collide import closest_approach, closest_approach_pairs
from automcm_maintenance.benches import bench_commands, kernels_bench
from automcm_maintenance.benches.plugin import BenchRow, BenchRun

BENCHES = """
import pytest
from automcm_maintenance.benches.plugin import beside

def bench_one(timed):
    timed(lambda: sum(range(1000)), per=10)

@pytest.mark.parametrize("n", [2, 3])
def bench_bytes(n, figure):
    figure(4.0 * n, "bytes")

@pytest.mark.parametrize("n", [2, 3, 4])
@beside("bytes", 2)
def bench_more(n, figure):
    figure(n * n * n, "bytes")

@beside("one", 9)
def bench_absent(timed):
    pytest.skip("it needs a [lathe]")
"""


def test_a_ratio_above_its_bar_falls_short_and_is_exit_code_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "window_bench.py").write_text(BENCHES)
    monkeypatch.setattr(bench_commands, "FOLDER", tmp_path)
    done = automcm("bench", "window", "--seconds", "0.01", "--json", tmp_path / "out.json")
    assert done.exit_code == 1 and done.stderr.count("falls short of its bar") == 1, done.output
    found = json.loads((tmp_path / "out.json").read_text())
    rows = {row["name"]: row for row in found["rows"]}
    assert rows["one"]["value"] > 0 and rows["one"]["ratio"] is None
    assert [rows[f"more[{n}]"]["ratio"] for n in (2, 3, 4)] == [1.0, 2.25, None]
    assert found["falls_short"] == ["more[3]"] and found["skipped"] == {
        "absent": "it needs a [lathe]"
    }
    assert "more[3]" in done.stdout and "it needs a [lathe]" in done.stdout
    (tmp_path / "window_bench.py").write_text("def bench_bad():\n    assert 1 == 2\n")
    done = automcm("bench", "window")
    assert done.exit_code == 3 and "assert 1 == 2" in done.output


def test_a_baseline_has_the_same_parameters_or_is_named_in_full() -> None:
    rows = [
        BenchRow("a[x]", 2.0, "s"),
        BenchRow("a", 4.0, "s"),
        BenchRow("b[x]", 1.0, "s", "a", 1.0),
    ]
    rows += [BenchRow("b[y]", 1.0, "s", "a", 1.0), BenchRow("b[z]", 1.0, "s", "a[x]", 1.0)]
    rows += [BenchRow("c", 1.0, "s", "c", 1.0)]
    run = BenchRun(rows, {})
    assert [run.ratio(row) for row in rows[2:]] == [0.5, 0.25, 0.5, None]


@pytest.mark.slow
@pytest.mark.parametrize("subject", ["station", "radio", "security", "traces"])
def test_each_bench_runs_and_has_a_baseline(subject: str) -> None:
    run = bench_commands.measured(subject, 0.01)
    names = {row.name for row in run.rows}
    own = [row for row in run.rows if row.beside]
    assert own and all(run.ratio(row) or row.beside == row.name for row in own), names


def test_every_subject_has_a_module() -> None:
    modules = {
        path.stem.removesuffix("_bench") for path in bench_commands.FOLDER.glob("*_bench.py")
    }
    assert modules == set(bench_commands.SUBJECTS)


def test_the_kernels_and_their_baselines_compute_the_same() -> None:
    a, b = kernels_bench.road(40), kernels_bench.road(40, -20.0, 3.5, 9.0)
    found = closest_approach(a, b)
    assert found is not None
    assert kernels_bench.cheapest(a, b) == pytest.approx(found.distance)
    t, one, other = kernels_bench.traffic(40, 30)
    many = closest_approach_pairs(t, one, other)
    assert kernels_bench.dense(one, other) == pytest.approx(many.distance, abs=1e-9)
    assert (np.diff(t) > 0).all()
