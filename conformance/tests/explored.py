"""Exploration against stations with two mistakes each, in rare states: every one is found in time,
and the walk is shortened to at most one and a half times the shortest that breaks the same rule.

    python conformance/tests/explored.py [--mutant NAME]... [--seeds N] [--seconds S]

The shortest is looked for in the graph of the walk: every pair of the rule, in the order of its
distance from the initial state, each by its shortest way.  Needs g++ and nlohmann/json.hpp.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from automcm_conformance.explore import explore
from automcm_conformance.explore import walk_shrinking as shrink
from automcm_conformance.explore.walk_shrinking import FailingWalk
from automcm_maintenance.code_mutation import cpp_station, faults
from automcm_maintenance.documents.repository import markdown_table

RATIO = 1.5
NEAREST = 20_000
"""Pairs tried in search of the shortest."""


@dataclass
class Row:
    """One exploration: acts sent until the rule is broken, and the fewest that do."""

    name: str
    seed: int
    seconds: float = 0.0
    rule: str = ""
    acts: int = 0
    shortest: int = 0
    failed: str = ""


@dataclass
class _Seen:
    """Looks on while a failure is shortened."""

    shorter: FailingWalk | None = None
    seconds: float = 0.0


def explored(name: str, station: Path, seed: int, seconds: float, folder: Path) -> Row:
    """Until the first failure; then the shortest is looked for."""
    row, seen, begun = Row(name, seed), _Seen(), time.monotonic()

    class Exhaustive(shrink.Shrinker):
        def shrink(self, found: FailingWalk) -> FailingWalk:
            short = super().shrink(found)
            seen.seconds = time.monotonic() - begun
            seen.shorter = short
            if short.setting.timed:
                self.near = self.runs = NEAREST
                seen.shorter = self.nearest(short)
            return short

    explore.Shrinker = Exhaustive  # type: ignore[misc]
    found = explore.explore(
        [str(station)],
        folder,
        limit_s=10.0,
        seed=seed,
        enough=1,
        notify=lambda text: None,
        more=lambda number: time.monotonic() - begun < seconds,
    )
    row.seconds = seen.seconds or time.monotonic() - begun
    if not found.cases or found.cases[0].verdict != "FAIL":
        row.failed = "; ".join([*found.problems, "not found"])
        return row
    (case,) = found.cases
    row.rule, row.acts = ", ".join(case.rules), found.acts[case.id]
    row.shortest = seen.shorter.sent if seen.shorter is not None else row.acts
    if row.seconds > seconds:
        row.failed = f"it took {row.seconds:.0f} s"
    if row.acts > RATIO * row.shortest:
        row.failed = f"{row.acts} acts, where {row.shortest} do"
    return row


def show(rows: Sequence[Row]) -> str:
    """The table, and the failures."""
    titles = ("station", "seed", "seconds", "rule", "acts", "shortest", "")
    cells = [
        (r.name, str(r.seed), f"{r.seconds:.1f}", r.rule, str(r.acts), str(r.shortest), r.failed)
        for r in rows
    ]
    return markdown_table(titles, cells, ("rule",))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--mutant", action="append", metavar="NAME", help="this station alone")
    parser.add_argument("--seeds", type=int, default=3, help="so many of them, from 1 on")
    parser.add_argument("--seconds", type=float, default=60.0, help="for each exploration")
    options = parser.parse_args()
    mutants = faults.load("cpp_combined")
    chosen = [m for m in mutants.values() if options.mutant is None or m.name in options.mutant]
    if not chosen or len(chosen) < len(set(options.mutant or ())):
        parser.error(f"--mutant must be one of {', '.join(mutants)}")
    if lacking := cpp_station.missing():
        print(f"SKIPPED: {lacking} is not installed", file=sys.stderr)
        return 0
    rows = []
    with TemporaryDirectory(prefix="automcm-explored-") as name:
        folder = Path(name)
        with ThreadPoolExecutor(2) as pool:
            stations = list(pool.map(lambda m: cpp_station.build_mutant(m, folder), chosen))
        for mutant, station in zip(chosen, stations, strict=True):
            for seed in range(1, options.seeds + 1):
                out = folder / f"{mutant.name}-{seed}"
                out.mkdir()
                rows.append(explored(mutant.name, station, seed, options.seconds, out))
    print(show(rows))
    failed = sum(bool(row.failed) for row in rows)
    print(f"{len(rows) - failed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
