"""Counterexamples name actions: the next-state relations are disjunctions of named ones."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import pytest

from automcm_spec.model_checking import models, tlc
from automcm_spec.model_checking.counterexample_steps import steps
from automcm_spec.support.paths import SIMULATION, TLA

TEXTS = {path.stem: path.read_text(encoding="utf-8") for path in TLA.glob("*.tla")}
LISTED = models.load()
CFGS = {path.stem: path.read_text() for path in SIMULATION.glob("*.cfg")}
CFGS |= {model.cfg: model.config for model in LISTED}


def specification(cfg: str) -> str:
    """The formula that a cfg gives to TLC."""
    (name,) = re.findall(r"(?m)^SPECIFICATION (\w+)$", cfg)
    return str(name)


def definitions(module: str) -> dict[str, str]:
    """The operators that a module sees, with their definitions."""
    found: dict[str, str] = {}
    for name in models.extended(module, TEXTS):
        code = re.sub(r"\\\*[^\n]*|\(\*.*?\*\)", "", TEXTS[name], flags=re.DOTALL)
        parts = re.split(r"(?m)^(\w+)(?:\([^=]*\))? *==", code)
        found |= dict(zip(parts[1::2], parts[2::2], strict=True))
    return found


def actions(module: str, formula: str) -> set[str]:
    """The body of a formula; for a Next, its parts."""
    known = definitions(module)
    while "[][" not in known[formula]:
        (formula,) = re.findall(r"\w+Spec", known[formula])
    (box,) = re.findall(r"\[\]\[(.*?)\]_", known[formula])
    return made_of(set(re.findall(r"\w+", box)), known)


def made_of(names: set[str], known: dict[str, str]) -> set[str]:
    """Names; for a Next, its parts."""
    nexts = {name for name in names if "Next" in name}
    inner = {name for n in nexts for name in re.findall(r"\w+", known[n])} & set(known)
    return names - nexts | (made_of(inner, known) if inner else set())


@pytest.mark.parametrize("name", sorted(CFGS))
def test_a_cfg_has_a_specification_or_says_why_not(name: str) -> None:
    lines = CFGS[name].splitlines()
    said = any("INIT" in line for line in lines if line.startswith("\\*"))
    parts = {line.split()[0] for line in lines if line.split()}
    assert "SPECIFICATION" in parts or said
    assert said or not parts & {"INIT", "NEXT"}


def quickest(found: Iterable[models.Model]) -> dict[str, models.Model]:
    """A model of each module."""
    return {m.module: m for m in sorted(found, key=lambda m: -m.seconds)}


MUST_FAIL = quickest(m for m in LISTED if m.expect == "violates")


@pytest.mark.slow
@pytest.mark.parametrize("module", sorted(MUST_FAIL))
def test_a_counterexample_names_actions(module: str) -> None:
    model = MUST_FAIL[module]
    verdict = models.check(model)
    assert verdict.outcome == "violates", verdict.problem
    named = [state.action for state in verdict.trace[1:]]
    assert named and set(named) <= actions(module, specification(model.config))
    assert not [name for name in named if "Next" in name]
    for action, step in zip(named, steps(verdict.trace), strict=True):
        assert step.text.startswith((f"{action} at station ", f"{action}: "))


def test_the_actions_of_system_are_named_after_the_kinds_of_inputs() -> None:
    """So the steps of a random walk get their names, where TLC has seen one action only."""
    kinds = set(re.findall(r'kind \|-> "(\w+)"', TEXTS["System"])) - {"start"}
    assert actions("System", "Spec") == {kind.capitalize() for kind in kinds}


@pytest.mark.slow
def test_the_next_of_the_random_behaviours_is_that_of_system(tmp_path: Path) -> None:
    """It is one action; the steps are the same, and as many."""
    model = next(m for m in LISTED if m.cfg == "restarts")
    rest, _ = models.split(model.config)
    cfg = tmp_path / "any.cfg"
    cfg.write_text(rest.replace("SPECIFICATION Spec", "SPECIFICATION AnySpec\nPROPERTY Spec"))
    found = tlc.run("Simulation", cfg, short=True)
    assert found.outcome == "holds"
    assert (found.distinct_states, found.states) == (model.distinct_states, model.states)


@pytest.mark.parametrize(
    ("module", "formula", "prefix", "of", "more"),
    [
        ("Together", "TogetherSpec", "Count", "TSpec", set()),
        ("TwoSessions", "FewSpec", "Few", "Spec", set()),
        ("Drift", "DriftSpec", "Kept", "TSpec", {"SlowTick"}),
        ("TimedCutoff", "TimedCutoffSpec", "", "TSpec", {"QuarantineElsewhere"}),
        ("AttackedTogether", "AttackedTogetherSpec", "Count", "TimedAttackedSpec", set()),
    ],
)
def test_a_next_made_of_another_leaves_none_of_its_actions_out(
    module: str, formula: str, prefix: str, of: str, more: set[str]
) -> None:
    made = actions(module, formula)
    assert made == more | {
        f"{prefix}{name}" if f"{prefix}{name}" in definitions(module) else name
        for name in actions(module, of)
    }
