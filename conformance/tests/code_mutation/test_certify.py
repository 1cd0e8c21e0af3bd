"""The certificate of the kit: mutants are made, told from the reference, and judged rightly."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from automcm_maintenance.code_mutation import certificate, certificate_page, equivalence, lockstep
from automcm_maintenance.code_mutation.certificate import (
    CertificateRun,
    KillCertificate,
    MutantRow,
    suite_hash,
)
from automcm_maintenance.code_mutation.faults import Edit
from automcm_maintenance.code_mutation.lockstep import Difference
from automcm_maintenance.code_mutation.mutated_process import NO_IMPORT, full_name
from automcm_maintenance.code_mutation.source_mutants import Generated, SourceMutant, path_of
from automcm_maintenance.code_mutation.station_behaviour import VARIANTS, AnyState
from automcm_spec.graph.oracle import load
from automcm_spec.graph.oracle_generation import GRAPHS

TIGHT = (("tight", 0),)


def changed(module: str, old: str, new: str) -> SourceMutant:
    """A mutant made by hand."""
    source = path_of(module).read_text(encoding="utf-8")
    mutated = Edit(full_name(module), old, new).apply(source)
    line = source[: source.index(old)].count("\n") + 1
    return SourceMutant(f"{module}/by hand/guard-1", "guard", module, line, "", old, new, mutated)


WRONG = (
    "actuating",
    '"ACT-3", from_own_prescriber, finished',
    '"ACT-3", from_own_prescriber, acked',
)


def test_what_does_not_import_is_told_from_what_is_wrong(tmp_path: Path) -> None:
    file = tmp_path / "source.py"
    file.write_text("1 / 0")
    command = [
        sys.executable,
        "-m",
        "automcm_maintenance.code_mutation.mutated_process",
        "rules",
        str(file),
    ]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert done.returncode == NO_IMPORT and "ZeroDivisionError" in done.stderr


def walked(mutant: SourceMutant, folder: Path) -> Difference | None:
    file = folder / "source.py"
    file.write_text(mutant.source, encoding="utf-8")
    return equivalence.first_difference(mutant, file, TIGHT, folder)


@pytest.mark.slow
def test_an_equivalent_mutant_is_called_so(tmp_path: Path) -> None:
    same = changed("prescribing", "not (st.phase == ", "True and not (st.phase == ")
    assert walked(same, tmp_path) is None
    selectors, walks = ("AMCM/STA/REL/TI-01",), (*TIGHT, ("tight", 1))
    asked = CertificateRun(tmp_path / "kept", selectors=selectors, walks=walks)
    (row,), problems = certificate.run([same], asked, lambda text: None)
    assert row.verdict == "equivalent" and problems == []


@pytest.mark.slow
def test_a_difference_is_found_and_shown(tmp_path: Path) -> None:
    found = walked(changed(*WRONG), tmp_path)
    assert found is not None and found.graph == "tight"
    assert '"Fin"' in found.input and found.state[1] == "receiver"
    assert "finished" in found.right and "finished" not in found.wrong


def test_a_walk_without_end_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(equivalence, "SECONDS", 0)
    with pytest.raises(equivalence.EquivalenceError, match="no end after 0 s"):
        walked(changed(*WRONG), tmp_path)


@pytest.mark.slow
def test_survivors_count_and_are_shown(tmp_path: Path) -> None:
    """A suite that cannot see a mutant, and one that can."""
    mutant = changed(*WRONG)
    blind = CertificateRun(tmp_path, selectors=("AMCM/STA/REL/TI-01",), jobs=1, walks=TIGHT)
    rows, problems = certificate.run([mutant], blind, lambda text: None)
    (row,) = rows
    assert row.verdict == "survived" and row.difference is not None and problems == []
    found = KillCertificate(blind, "ab" * 32, Generated([mutant]), 1, rows)
    assert found.exit_code == 1 and found.as_dict()["counts"] == {"survived": 1}
    shown = certificate_page.summary(found)
    assert mutant.id in shown and row.difference.input in shown
    seeing = replace(blind, selectors=("ACT-3",), cases=1)
    (row,), problems = certificate.run([mutant], seeing, lambda text: None)
    assert row.verdict == "killed" and len(row.cases) == 1 and problems == []


KILLED = MutantRow(
    "state/armed/timer-1", "timer", "reference/automcm/core/state.py", 9, "ACT-5", "a | b", "a"
)


@pytest.mark.parametrize("ends", [None, "forms", "one-peer", "two-peers"])
def test_only_who_is_compared_on_every_graph_is_equivalent(
    ends: str | None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A comparison that breaks off leaves a mutant that no case kills undecided."""
    walked: list[tuple[str, int]] = []

    def first_difference(_: object, __: object, walks: Any, ___: object) -> None:
        walked.extend(walks)
        if ends in {graph for graph, _ in walks}:
            raise equivalence.EquivalenceError("no end")

    monkeypatch.setattr(equivalence, "first_difference", first_difference)

    def survives(row: MutantRow, *_: object) -> None:
        row.verdict = "survived"

    monkeypatch.setattr(certificate, "_hold", survives)
    asked, values = CertificateRun(tmp_path), asdict(changed(*WRONG))
    row = MutantRow.of(certificate._judge(asked, values))
    if ends is None:
        assert row.verdict == "equivalent" and sorted(walked) == sorted(equivalence.WALKS)
    else:
        assert row.verdict == "undecided" and row.why == "no end"


def test_the_page_is_made_of_the_certificate() -> None:
    killed = replace(KILLED, verdict="killed", cases=["AMCM/PRE/ACT/TI-01", "AMCM/STA/REL/TI-02"])
    difference = Difference("tight", ["STANDALONE"], '["restart"]', "one", "other")
    survived = replace(KILLED, id="state/key/field-1", class_="field", verdict="survived")
    survived.difference = difference
    asked = CertificateRun(Path(), seed=7)
    found = KillCertificate(asked, "ab" * 32, Generated([]), 2, [killed, survived])
    made = json.loads(json.dumps({"inputs": suite_hash(asked)} | found.as_dict()))
    text = certificate_page.markdown(made)
    assert "*Stale*" not in text and "*Stale*" in certificate_page.markdown(made | {"seed": 8})
    assert "| timer | 1 | 1 | 0 | 0 | 0 | 0 |" in text
    assert "| class | mutants | ACT | REL |" in text and "| timer | 1 | 1 | 1 |" in text
    assert "`a \\| b  =>  a` | PRE/ACT/TI-01, STA/REL/TI-02 |" in text
    assert "right one" in text and "wrong other" in text and "seed 7" in text


def test_no_docstring_makes_it_stale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certificate, "SUITE", tmp_path)
    found = []
    for text in ('"""A."""\nx = 1', '"""B\n\n."""\nx = 1', '"""A."""; x = 1', '"""A."""; x = 2'):
        (tmp_path / "suite.py").write_text(text)
        found.append(suite_hash(CertificateRun(tmp_path)))
    assert found[0] == found[1] and len({*found}) == 3


def test_an_output_at_an_input_that_no_graph_has_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    walker = AnyState(load(GRAPHS["tight"].path), VARIANTS[0])
    monkeypatch.setitem(walker._extra, "all timers, later", list)
    with lockstep.unchanged("tight", 0) as right:
        found = lockstep.first_difference("tight", walker, right)
    assert found is not None and found.input == "all timers, later"
