"""Mutants of the modules, and the command."""

from __future__ import annotations

import json
import sys
from functools import cache, partial
from pathlib import Path
from typing import Any

import pytest
from mutant_stage import OTHER, TINY, changes, tiny
from mutant_stage import folder as folder
from typer.testing import CliRunner

from automcm_cli.main import app
from automcm_maintenance.spec_mutation import mutant_results, mutant_runs, mutants
from automcm_maintenance.spec_mutation.mutant_rules import KINDS, MODULES, NOT_MUTATED
from automcm_maintenance.spec_mutation.mutants import Mutant
from automcm_spec.model_checking import models
from automcm_spec.support.paths import TLA

generated = cache(mutants.generate)


def test_the_modules_give_many_mutants_each_with_its_own_stable_id() -> None:
    found = generated()
    assert len(found) >= 250
    assert len({m.id for m in found}) == len(found)
    assert found == mutants.generate()
    assert {m.kind for m in found} == set(KINDS)
    assert {m.module for m in found} == set(MODULES)


def test_a_mutant_can_be_parsed() -> None:
    parser = mutants._parser()
    for mutant in mutants.sample(generated(), 40):
        source = (TLA / f"{mutant.module}.tla").read_bytes()
        changed = mutant.apply(source)
        assert changed != source and not parser.parse(changed).root_node.has_error, mutant


def test_what_is_left_alone() -> None:
    found = generated()
    assert not {f"{m.module}.{m.operator}" for m in found} & set(NOT_MUTATED)
    assert not {m.operator for m in found} & set(models.PROPERTIES.values())
    for name in NOT_MUTATED:
        module, definition = name.split(".")
        assert f"\n{definition}" in (TLA / f"{module}.tla").read_text(), name


def test_ids_survive_edits_elsewhere(folder: Path) -> None:
    before = {m.id for m in mutants.generate(folder, ["Tiny"])}
    text = TINY.replace("Init ==", "\\* new\nNew(x) == x + 1\nInit ==")
    (folder / "Tiny.tla").write_text(text)
    after = {m.id for m in mutants.generate(folder, ["Tiny"])}
    assert after > before and {i.split(".")[1] for i in after - before} == {"New"}


def kinds(folder: Path, operator: str) -> list[tuple[str, str, str]]:
    return [
        (m.kind, m.before, m.after)
        for m in mutants.generate(folder, ["Other"])
        if m.operator == operator
    ]


def test_case_arms_are_ignored_inputs_or_fall_to_other(folder: Path) -> None:
    actions = [after for kind, _, after in kinds(folder, "Pick") if kind == "action"]
    assert actions == ['Ignore(st, "-")', 'm.type = "Ack" -> Ignore(st, "-")']
    assert ("disjunct", "st.a -> {st.b, 2} []", "") in kinds(folder, "Late")
    # No condition of a CASE without OTHER is changed.
    assert not any("Fin" in before for kind, before, _ in kinds(folder, "Pick") if kind != "action")


def test_members_conjuncts_and_history(folder: Path) -> None:
    late = kinds(folder, "Late")
    assert ("member", "st.a -> {st.b, 2}", "st.a -> {2}") in late
    assert ("conjunct", "/\\ x # 1", "") in late
    assert ("member", "/\\ x \\in st.d \\ {4}", "/\\ x \\in st.d") in late
    assert kinds(folder, "Do") == [("assignment", "/\\ st' = x", "/\\ st' = st")]
    told = """<<"fallback", "timeout">>""", """<<"fallback", "closed" >>"""
    [(kind, before, after)] = kinds(folder, "Told")
    assert kind == "constant" and before.replace(*told) == after
    assert ("number", "j >= s \\/ j = s", "j > s \\/ j = s") in kinds(folder, "Over")


def test_a_negated_list_of_conjuncts_keeps_its_columns(folder: Path) -> None:
    [mutant] = [m for m in changes(folder, "Other").values() if m.after.startswith("~(")]
    lines = mutant.apply(OTHER.encode()).decode().splitlines()
    first = next(n for n, line in enumerate(lines) if line.endswith("/\\ st.a"))
    assert lines[first].index("/\\") == lines[first + 1].index("/\\")


def test_the_sample_is_a_fixed_one() -> None:
    found = generated()
    few, more = mutants.sample(found, 10), mutants.sample(found, 20)
    assert len(few) == 10 and set(few) < set(more) and more == mutants.sample(found, 20)
    assert mutants.sample(found, None) == found


def test_without_the_packages_one_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tree_sitter_tlaplus", None)
    answer = CliRunner().invoke(app, ["spec", "mutate", "--list"])
    assert answer.exit_code == 3 and "extra 'mutate'" in answer.output


def test_the_command_lists() -> None:
    answer = CliRunner().invoke(app, ["spec", "mutate", "--list", "--limit", "5"])
    assert answer.exit_code == 0 and "5 mutants: " in answer.output
    answer = CliRunner().invoke(
        app, ["spec", "mutate", "--list", "--only", "Heeded", "--json", "-"]
    )
    assert {row["id"].split(".")[1] for row in json.loads(answer.output)} == {"Heeded"}


@pytest.mark.parametrize(
    "options",
    [
        ["--profile", "huge"],
        ["--only", "Nobody.At.All"],
        ["--write", "--profile", "deep", "--only", "OnAck"],
        ["--write"],
        ["--limit", "-1"],
    ],
)
def test_the_command_refuses(monkeypatch: pytest.MonkeyPatch, options: list[str]) -> None:
    monkeypatch.setattr(models, "load", lambda: [tiny()])
    assert CliRunner().invoke(app, ["spec", "mutate", *options]).exit_code == 2


def test_the_command_reports(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """S-1 kills each mutant but the last, of which only the graph differs."""
    monkeypatch.setattr(mutants, "generate", generated)
    wanted = mutants.sample(generated(), 3)
    kill = mutant_runs.Kill("one_by_two", "property", "S-1")
    graph = mutant_runs.Kill("the oracle", "graph", "tight differs")

    def pretended(found: list[Mutant], *_: Any, **options: Any) -> mutant_runs.MutationReport:
        outcomes = [
            mutant_runs.MutantOutcome(m, (kill if m != found[-1] else graph,)) for m in found
        ]
        return mutant_runs.MutationReport(options["profile"], len(found), outcomes)

    monkeypatch.setattr(mutant_runs, "run", pretended)
    monkeypatch.setattr(models, "load", lambda: [tiny()])
    monkeypatch.setattr(mutant_results, "reasons", dict)
    run = partial(CliRunner().invoke, app)
    answer = run(["spec", "mutate", "--limit", "3"])
    assert answer.exit_code == 1, answer.output
    assert "S-1 2" in answer.output and f"Survived    {wanted[-1].id}" in answer.output
    assert f"Problem     no property kills {wanted[-1].id}" in answer.output
    answer = run(["spec", "mutate", "--limit", "3", "--json", "-"])
    found = json.loads(answer.output)
    assert found["properties"]["S-1"] == 2 and found["kinds"]["all"]["property"] == 2
    path = tmp_path / "results.json"
    write = mutant_results.write
    monkeypatch.setattr(mutant_results, "write", lambda rows: write(rows, path))
    assert run(["spec", "mutate", "--write", "--profile", "deep", "--limit", "3"]).exit_code == 1
    results = mutant_results.load(path)
    assert not results.stale and "a property kills 2 (66.7%)" in results.summary
    assert f"- `{wanted[-1].id}` (line {wanted[-1].line}, graph)" in mutant_results.page(results)
