"""The bench runs, and its baselines compute the same as the kernels."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from automcm.kernels.collide import closest_approach, closest_approach_pairs
from automcm.kernels.thin import thin
from automcm_maintenance.benches import kernel_bench


def test_report() -> None:
    report = kernel_bench.run(0.05, points=(40,), pairs=(1, 4))
    assert {row.kernel for row in report.rows} == {
        *("convert", "thin", "thin_noisy", "discover", "prescribe", "verify", "success"),
        *(
            "closest_approach",
            "collision",
            "clearance",
            "clearance_lorry",
            "project",
            "pairs",
            "many",
        ),
    }
    fields = report.as_dict()
    assert len(fields["rows"]) == len(report.rows)
    assert all(row["us"] > 0 and row["floor_us"] > 0 for row in fields["rows"])
    assert set(fields["missing"]) <= {"shapely", "commonroad_dc.pycrcc"}
    assert fields["discs_to_points"][40]["clearance"] > 0


def test_a_peer_that_is_not_there_has_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "commonroad_dc.pycrcc", None)
    report = kernel_bench.run(0.05, points=(40,), pairs=(1,))
    assert "commonroad_dc.pycrcc" in report.missing["commonroad_dc.pycrcc"]
    assert all(row.pycrcc_us is None for row in report.rows)


def test_peers_agree() -> None:
    a, b = kernel_bench.road(40), kernel_bench.road(40, -20.0, 3.5, 9.0)
    found = closest_approach(a, b)
    assert found is not None
    rows = [
        [(t, *xy) for t, xy in zip(each.t.tolist(), each.xy.tolist(), strict=True)]
        for each in (a, b)
    ]
    assert kernel_bench._python_approach(*rows) == pytest.approx((found.distance, found.time))
    assert kernel_bench._cheapest(a, b) == pytest.approx(found.distance)
    t, one, other = kernel_bench.traffic(40, 30)
    many = closest_approach_pairs(t, one, other)
    assert kernel_bench._dense(one, other) == pytest.approx(many.distance, abs=1e-9)
    assert (np.diff(t) > 0).all()
    thinned = thin(a, 10**6, len, speed=1e9)
    kept = kernel_bench._python_thin(a.t.tolist(), a.xy.tolist())
    assert a.t[kept].tolist() == thinned.t.tolist()
