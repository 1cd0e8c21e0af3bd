"""Mutants of the modules."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from mutant_stage import OTHER, TINY, changes
from mutant_stage import folder as folder

from automcm_maintenance.spec_mutation import mutants
from automcm_maintenance.spec_mutation.mutant_rules import KINDS, MODULES, NOT_MUTATED
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
