"""Models run on mutants, and the report of a run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mutant_stage import TINY, changes, tiny, with_cfg
from mutant_stage import folder as folder

from automcm_maintenance.spec_mutation import mutant_runs, mutants
from automcm_maintenance.spec_mutation.mutants import Mutant
from automcm_spec.model_checking import models
from automcm_spec.model_checking.models import Model, ModelVerdict
from automcm_spec.model_checking.tlc import ErrorKind, TlcError, TlcResult


def run(chosen: list[Model], wanted: list[Mutant], folder: Path, **options: Any) -> Any:
    return mutant_runs.run(
        wanted,
        [with_cfg(folder, m) for m in chosen],
        tla=folder,
        **({"jobs": 1} | options),
    )


@pytest.mark.slow
def test_a_property_kills_counts_kill_and_an_equivalent_mutant_survives(folder: Path) -> None:
    by_change = changes(folder, "Tiny")
    step, same = "IF x < 3 THEN x + 1 ELSE 0", "IF x > 7 THEN 0 ELSE x"
    off = by_change[f"{step}  =>  IF x <= 3 THEN x + 1 ELSE 0"]
    still = by_change[f"{step}  =>  IF x < 3 THEN x + 0 ELSE 0"]
    equal = by_change[f"{same}  =>  IF x >= 7 THEN 0 ELSE x"]
    broken = Mutant("Tiny.Step.x.0", "Tiny", "Step", "guard", 5, 60, 62, b"((", "a", "b")
    kept: list[Any] = []
    report = run([tiny()], [off, still, equal, broken], folder, jobs=2, keep=kept.append)
    assert [o.row.how for o in report.outcomes] == ["property", "counts", "none", "none"]
    assert report.outcomes[0].properties == ["Small"]
    assert report.outcomes[1].survived and report.outcomes[2].survived
    assert report.outcomes[3].invalid and len(report.rows) == 3
    assert report.complete and report.exit_code == 0
    assert len(kept) == 4 and all(one in report.outcomes for one in kept)


Answer = Callable[[Model, list[str]], ModelVerdict]


def ok(model: Model, problem: str | None = None) -> ModelVerdict:
    return ModelVerdict(
        model, model.expect, model.property, TlcResult("holds", None, 1, 1, 1, 1), problem
    )


def violated(model: Model, name: str | None) -> ModelVerdict:
    id_ = None if name is None else {"OneSessionProp": "S-1"}.get(name, name)
    return ModelVerdict(model, "violates", id_, TlcResult("violates", name, 1, 1, 1, 1), "violated")


def failed(model: Model, kind: ErrorKind) -> ModelVerdict:
    return ModelVerdict(model, "error", None, None, "no verdict", TlcError(kind, kind))


@pytest.fixture
def pretend(monkeypatch: pytest.MonkeyPatch, folder: Path) -> Callable[[Answer], list[str]]:
    """Replaces TLC: its result for a mutant, by the model and its properties."""

    def install(answer: Answer) -> list[str]:
        ran: list[str] = []

        def check(model: Model, *, tla_dir: Path, **_: object) -> ModelVerdict:
            if (tla_dir / "Tiny.tla").read_text() == TINY:
                return ok(model)
            ran.append(model.cfg)
            return answer(model, models.checked_in(model.config))

        monkeypatch.setattr(models, "check", check)
        return ran

    for name in "acd":
        text = "INIT Init\nNEXT Next\nINVARIANT Small\nPROPERTIES OneSessionProp Live\n"
        (folder / f"{name}.cfg").write_text(text)
    return install


THREE = [tiny("d", 30), tiny("c", 5), tiny("a", 2)]


def test_after_a_kill_by_counts_a_property_is_looked_for(folder: Path, pretend: Any) -> None:
    def answer(model: Model, checked: list[str]) -> ModelVerdict:
        return ok(model, "depth is 3") if model.cfg == "a" else violated(model, "OneSessionProp")

    ran = pretend(answer)
    one = mutants.generate(folder, ["Tiny"])[:1]
    [outcome] = run(THREE, one, folder).outcomes
    assert ran == ["a", "c"] and outcome.row.how == "property"
    assert [(k.how, k.what) for k in outcome.kills] == [
        ("counts", "depth is 3"),
        ("property", "S-1"),
    ]


@pytest.mark.parametrize(
    ("how", "answer"),
    [
        ("probe", lambda m, _: ok(m, "reached too much") if m.cfg == "d" else ok(m)),
        ("probe", lambda m, _: ok(m, "no longer reached: END-8") if m.cfg == "d" else ok(m)),
        ("evaluation", lambda m, _: failed(m, "other")),
        ("timeout", lambda m, _: failed(m, "timeout")),
        ("property", lambda m, _: violated(m, "X") if m.cfg == "c" else failed(m, "timeout")),
        ("timeout", lambda m, _: failed(m, "memory")),
        ("counts", lambda m, _: ok(m, "depth") if m.cfg == "a" else ok(m)),
        ("none", lambda m, _: ok(m)),
    ],
)
def test_what_finds_a_mutant(folder: Path, pretend: Any, how: str, answer: Answer) -> None:
    pretend(answer)
    [outcome] = run(THREE, mutants.generate(folder, ["Tiny"])[:1], folder).outcomes
    assert outcome.row.how == how and outcome.survived == (how != "property")


@pytest.mark.parametrize(
    ("profile", "names", "properties", "runs"),
    [
        ("quick", ["Small"], ["Small"], ["a"]),
        ("quick", [None], ["Live"], ["a"] * 3),
        ("deep", ["Small", None], ["Live", "Small"], ["a"] * 4 + ["c", "d"]),
    ],
)
def test_properties_that_kill(
    folder: Path, pretend: Any, profile: str, names: Any, properties: Any, runs: Any
) -> None:
    """A temporal property, which TLC does not name, is named; deep finds every property."""

    def answer(model: Model, checked: list[str]) -> ModelVerdict:
        if model.cfg != "a" or checked == ["OneSessionProp"]:
            return ok(model)
        return violated(model, "Small" if "Small" in names and "Small" in checked else None)

    ran = pretend(answer)
    one = mutants.generate(folder, ["Tiny"])[:1]
    [outcome] = run(THREE, one, folder, profile=profile).outcomes
    assert (outcome.properties, ran) == (properties, runs)


def test_a_model_that_is_wrong_without_a_mutant_ends_the_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(models, "check", lambda model, **_: ok(model, "depth is 3"))
    with pytest.raises(mutant_runs.MutationError, match="tiny is not as expected without a mutant"):
        run([tiny()], mutants.generate(folder, ["Tiny"]), folder)


@pytest.mark.slow
def test_a_mutant_that_only_changes_answers_is_found_in_the_graph() -> None:
    """No model is asked: an answer with a seq differs in the graph of one station."""
    mutant = next(m for m in mutants.generate() if m.operator == "AnswerSeq" and m.kind == "number")
    (outcome,) = mutant_runs.run([mutant], [], jobs=1).outcomes
    assert outcome.row.how == "graph"
