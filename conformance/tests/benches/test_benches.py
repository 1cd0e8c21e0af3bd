"""``automcm bench``: each bench runs, and its baseline computes the same."""

from __future__ import annotations

import pytest

from automcm.kernels.collide import closest_approach
from automcm_maintenance.benches import bench_commands, kernels_bench


@pytest.mark.slow
@pytest.mark.parametrize("subject", ["station", "radio", "traces"])
def test_each_bench_runs_and_has_a_baseline(subject: str) -> None:
    run = bench_commands.measured(subject, 0.01)
    names = {row.name for row in run.rows}
    own = [row for row in run.rows if row.beside]
    assert own and all(run.ratio(row) or row.beside == row.name for row in own), names


def test_a_kernel_and_its_baseline_compute_the_same() -> None:
    a, b = kernels_bench.road(40), kernels_bench.road(40, -20.0, 3.5, 9.0)
    found = closest_approach(a, b)
    assert found is not None
    assert kernels_bench.cheapest(a, b) == pytest.approx(found.distance)
