"""Exploration against stations with two mistakes each, in rare states: every one is found in time,
and the walk is shortened to at most one and a half times the shortest that breaks the same rule.

    pytest conformance/tests/explored.py [-k NAME]

The shortest is looked for in the graph of the walk: every pair of the rule, in the order of its
distance from the initial state, each by its shortest way.  Needs g++ and nlohmann/json.hpp.
"""

from __future__ import annotations

import time
from pathlib import Path
from unittest.mock import patch

import pytest

from automcm_conformance.explore import explore
from automcm_conformance.explore.walk_shrinking import FailingWalk, Shrinker
from automcm_maintenance.code_mutation import cpp_station, faults

RATIO = 1.5
SECONDS = 60.0
NEAREST = 20_000
"""Pairs tried in search of the shortest."""
MUTANTS = faults.load("cpp_combined")


@pytest.fixture(scope="module")
def stations(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The stations that are built."""
    if lacking := cpp_station.missing():
        pytest.skip(f"{lacking} is not installed")
    return {"": tmp_path_factory.mktemp("stations")}


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", MUTANTS)
def test_two_mistakes_are_found_in_time_and_shortened(
    name: str, seed: int, stations: dict[str, Path], tmp_path: Path
) -> None:
    if name not in stations:
        stations[name] = cpp_station.build_mutant(MUTANTS[name], stations[""])
    begun = time.monotonic()
    found_after, shortest = 0.0, 0

    class Exhaustive(Shrinker):
        def shrink(self, found: FailingWalk) -> FailingWalk:
            nonlocal found_after, shortest
            short = super().shrink(found)
            found_after = time.monotonic() - begun
            shortest = short.sent
            if short.setting.timed:
                self.near = self.runs = NEAREST
                nearest = self.nearest(short)
                shortest = nearest.sent if nearest is not None else shortest
            return short

    with patch.object(explore, "Shrinker", Exhaustive):
        found = explore.explore(
            [str(stations[name])],
            tmp_path,
            limit_s=10.0,
            seed=seed,
            enough=1,
            notify=lambda text: None,
            more=lambda number: time.monotonic() - begun < SECONDS,
        )
    assert [case.verdict for case in found.cases] == ["FAIL"], found.problems
    acts = found.acts[found.cases[0].id]
    print(f"{name}, seed {seed}: {found.cases[0].rules} after {found_after:.0f} s, {acts} acts")
    assert found_after <= SECONDS and acts <= RATIO * shortest, (found_after, acts, shortest)
