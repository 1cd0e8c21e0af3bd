"""The committed results of mutants: their hash, their figures, the reasons."""

from __future__ import annotations

from pathlib import Path

import pytest

from automcm_maintenance.documents import repository
from automcm_maintenance.spec_mutation import mutant_results
from automcm_maintenance.spec_mutation.mutant_results import MutantResult


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
        mutant_results.write("", [KILLED], tmp_path / "results.json")
        found = mutant_results.load(tmp_path / "results.json")
        assert found.mutants == [KILLED] and not found.stale and "*Stale*" not in found.summary
        changed = tmp_path / part
        (changed if changed.suffix else changed / "one").write_text("2" + part)
        assert found.stale and found.summary.startswith("*Stale*: "), part


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
