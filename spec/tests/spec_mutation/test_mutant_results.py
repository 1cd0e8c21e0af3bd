"""The committed results of mutants: their hash, their figures, the reasons."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from automcm_maintenance.documents import repository
from automcm_maintenance.spec_mutation import mutant_results, mutants, mutate_commands
from automcm_maintenance.spec_mutation.mutant_results import MutantResult
from automcm_maintenance.spec_mutation.mutant_runs import MutantOutcome, MutationReport
from automcm_maintenance.spec_mutation.mutants import Mutant


def row(name: str, properties: str = "", differs: str = "") -> MutantResult:
    change = "a  =>  b"
    return MutantResult(
        id=name, line=1, change=change, properties=properties.split(), differs=differs.split()
    )


KILLED = row("Station.Up.guard.1", "S-1 S-5", "counts")
SEEN = row("Station.Up.guard.2", "", "graph counts")
ALIVE = row("System.Next.number.3")


def test_every_input_makes_the_results_stale(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for part in mutant_results.INPUTS:
        path = tmp_path / part
        path = path if path.suffix else path / "one"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("1")
    for part in mutant_results.INPUTS:
        assert (repository.ROOT / part).exists()
    monkeypatch.setattr(mutant_results, "ROOT", tmp_path)
    for part in mutant_results.INPUTS:
        results = tmp_path / "results.json"
        mutant_results.write("quick run of 1 of 9", [KILLED], results)
        found = mutant_results.load(results)
        assert found.mutants == [KILLED] and not found.stale and "*Stale*" not in found.summary
        assert mutant_results.before("quick", results) == [KILLED]
        assert mutant_results.before("deep", results) == []
        changed = tmp_path / part
        (changed if changed.suffix else changed / "one").write_text("2" + part)
        assert found.stale and found.summary.startswith("*Stale*: "), part
        assert mutant_results.before("quick", results) == [], part


def test_only_a_property_kills_and_the_rest_is_apart() -> None:
    rows = [KILLED, SEEN, ALIVE]
    found = mutant_results.MutationResults(inputs="", run="quick run of 3 of 9", mutants=rows)
    assert "Of 3 mutants of Station and System (quick run of 3 of 9), a property" in found.summary
    text = "a property kills 1 (33.3%). Of the other 2, "
    assert text + "1 show another difference, which is no kill (1 graph), and 1" in found.summary
    assert mutant_results.by_kind(found.mutants)["guard"] == [2, 1, 0, 1, 0, 0, 0, 0]
    killed = mutant_results.by_property(found.mutants)
    assert killed["S-1"] == killed["S-5"] == 1 and killed["S-2"] == 0


def test_a_mutant_that_no_property_kills_needs_a_reason_and_no_other() -> None:
    known = {KILLED.id: "a", SEEN.id: "b", "Station.Gone.x.0": "c"}
    rows = [KILLED, SEEN, ALIVE]
    assert mutant_results.problems(rows, known, {row.id for row in rows}) == [
        f"no property kills {ALIVE.id} (a  =>  b), and no-property.toml does not say why",
        f"no-property.toml lists {KILLED.id}, but S-1 kills it",
        "no-property.toml lists Station.Gone.x.0, but there is no such mutant",
    ]


def test_a_run_continues_from_what_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = tmp_path / "results.json"
    for name in ("before", "write"):
        with_path = partial(getattr(mutant_results, name), path=results)
        monkeypatch.setattr(mutant_results, name, with_path)
    wanted = mutants.generate()[:3]
    ran: list[str] = []

    def run(left: Sequence[Mutant], *_: object, keep: Any, **__: object) -> MutationReport:
        outcomes = [MutantOutcome(mutant, ()) for mutant in left[:2]]
        ran.extend(outcome.mutant.id for outcome in outcomes)
        list(map(keep, outcomes))
        return MutationReport("quick", len(left), outcomes)

    monkeypatch.setattr(mutate_commands.mutant_runs, "run", run)
    mutant_results.write("quick run of 0 of 790", [])
    for _ in range(2):
        report = mutate_commands.run("quick", wanted, 1, print, write=True)
    assert ran == [mutant.id for mutant in wanted] and report.complete
    assert len(report.rows) == 3 == len(mutant_results.load(results).mutants)
