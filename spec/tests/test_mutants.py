"""Mutants of the modules, how models are held against them, and the list of survivors."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from automcm_cli.main import app
from automcm_maintenance.spec_mutation import mutant_runs, mutants, mutate_commands, survivors
from automcm_maintenance.spec_mutation.mutant_rules import KINDS, MODULES, NOT_MUTATED
from automcm_maintenance.spec_mutation.mutants import Mutant
from automcm_spec.model_checking import models
from automcm_spec.model_checking.models import Model, Verdict
from automcm_spec.model_checking.tlc import ErrorKind, Result, TlcError
from automcm_spec.support.paths import TLA

TINY = r"""---- MODULE Tiny ----
EXTENDS Naturals
VARIABLE n
Init == n = 0
Step(x) == IF x < 3 THEN x + 1 ELSE 0
Same(x) == IF x > 7 THEN 0 ELSE x
Next == n' = Same(Step(n))
\* Helpers of the properties
Small == n <= 3
====
"""
OTHER = r"""---- MODULE Other ----
EXTENDS Naturals
Pick(st, m) ==
  CASE m.type = "Fin" -> [st EXCEPT !.phase = "WAITING", !.session[1] = @ + 1]
    [] m.type = "Ack" -> st   \* not "Fin"
Late(st) ==
  CASE st.a -> {st.b, 2}
    [] OTHER -> {x \in st.c : /\ x # 1
                              /\ x \in st.d \ {4}}
Guarded(st) == IF /\ st.a
                  /\ ~st.b  THEN "lease" ELSE "none"
Do(x) == /\ st' = x
         /\ last' = [rule |-> "ADV-1", phase |-> "WAITING"]
Told(st) == Effect(st, {}, <<"fallback", "timeout">>, "ADV-1")
Over(j, s) == j >= s \/ j = s
=====
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "Tiny.tla").write_text(TINY)
    (tmp_path / "Other.tla").write_text(OTHER)
    (tmp_path / "tiny.cfg").write_text("INIT Init\nNEXT Next\nINVARIANTS Small \\* one\n")
    return tmp_path


def tiny(cfg: str = "tiny", seconds: float = 1, states: int = 5, **changes: Any) -> Model:
    entry = {
        "cfg": cfg,
        "module": "Tiny",
        "expect": "holds",
        "profile": "quick",
        "why": "A test.",
        "seconds": seconds,
        "distinct_states": 4,
        "states": states,
        "depth": 4,
    }
    return Model.model_validate(entry | changes)


def must_fail(cfg: str, seconds: float) -> Model:
    none: dict[str, Any] = {"distinct_states": None, "states": None, "depth": None}
    rest: dict[str, Any] = {
        "property": "S-1",
        "breaks": "OneSessionProp",
        "length": 3,
        "expect": "violates",
        "why": "One is taken away. Then it breaks.",
    }
    return tiny(cfg, seconds, **(none | rest))


def run(chosen: list[Model], wanted: list[Mutant], folder: Path, **options: Any) -> Any:
    return mutant_runs.run(
        wanted, chosen, tla=folder, models_dir=folder, **({"jobs": 1, "search_s": 9} | options)
    )


def changes(folder: Path, module: str) -> dict[str, Mutant]:
    return {m.change: m for m in mutants.generate(folder, [module])}


def test_the_modules_give_many_mutants_each_with_its_own_stable_id() -> None:
    found = mutants.generate()
    assert len(found) >= 250
    assert len({m.id for m in found}) == len(found)
    assert found == mutants.generate()
    assert {m.kind for m in found} == set(KINDS)
    assert {m.module for m in found} == set(MODULES)


def test_a_mutant_can_be_parsed() -> None:
    parser = mutants._parser()
    for mutant in mutants.sample(mutants.generate(), 80):
        source = (TLA / f"{mutant.module}.tla").read_bytes()
        changed = mutant.apply(source)
        assert changed != source and not parser.parse(changed).root_node.has_error, mutant


def test_what_is_left_alone() -> None:
    found = mutants.generate()
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
    found = mutants.generate()
    few, more = mutants.sample(found, 10), mutants.sample(found, 20)
    assert len(few) == 10 and set(few) < set(more) and more == mutants.sample(found, 20)
    assert mutants.sample(found, None) == found


@pytest.mark.slow
def test_a_property_kills_counts_kill_and_an_equivalent_mutant_survives(folder: Path) -> None:
    by_change = changes(folder, "Tiny")
    step, same = "IF x < 3 THEN x + 1 ELSE 0", "IF x > 7 THEN 0 ELSE x"
    off = by_change[f"{step}  =>  IF x <= 3 THEN x + 1 ELSE 0"]
    still = by_change[f"{step}  =>  IF x < 3 THEN x + 0 ELSE 0"]
    equal = by_change[f"{same}  =>  IF x >= 7 THEN 0 ELSE x"]
    broken = Mutant("Tiny.Step.x.0", "Tiny", "Step", "guard", 5, 60, 62, b"((", "a", "b")
    cache = folder / "runs" / "cache.jsonl"
    report = run([tiny()], [off, still, equal, broken], folder, cache=cache, jobs=2)
    assert [o.how for o in report.outcomes] == ["property", "counts", None, None]
    assert report.outcomes[0].properties == ["Small"]
    assert report.outcomes[2].survived and report.outcomes[3].invalid
    assert report.complete and report.exit_code == 0
    with cache.open("a") as file:
        file.write('["half a li')
    with pytest.MonkeyPatch.context() as patch:  # nothing is run again
        patch.delattr(models, "check")
        again = run([tiny()], [off, still, equal, broken], folder, cache=cache)
    assert again.outcomes == report.outcomes


Answer = Callable[[Model, list[str]], Verdict]


def ok(model: Model, problem: str | None = None) -> Verdict:
    return Verdict(model, model.expect, model.property, Result("holds", None, 1, 1, 1, 1), problem)


def violated(model: Model, name: str | None) -> Verdict:
    id_ = None if name is None else {"OneSessionProp": "S-1"}.get(name, name)
    return Verdict(model, "violates", id_, Result("violates", name, 1, 1, 1, 1), "violated")


def failed(model: Model, kind: ErrorKind) -> Verdict:
    return Verdict(model, "error", None, None, "no verdict", TlcError(kind, kind))


@pytest.fixture
def pretend(monkeypatch: pytest.MonkeyPatch, folder: Path) -> Callable[[Answer], list[str]]:
    """Instead of TLC: what it says of a mutant, by the model and what the cfg checks."""

    def install(answer: Answer) -> list[str]:
        ran: list[str] = []

        def check(model: Model, *, models_dir: Path, tla_dir: Path, **_: object) -> Verdict:
            if (tla_dir / "Tiny.tla").read_text() == TINY:
                return ok(model)
            ran.append(model.cfg)
            return answer(model, models.checked_in(models_dir / f"{model.cfg}.cfg"))

        monkeypatch.setattr(models, "check", check)
        return ran

    for name in "abcd":
        text = "INIT Init\nNEXT Next\nINVARIANT Small\nPROPERTIES OneSessionProp Live\n"
        (folder / f"{name}.cfg").write_text(text)
    return install


FOUR = [tiny("d", 30), must_fail("b", 1), tiny("c", 5), tiny("a", 2)]


def test_after_a_kill_by_counts_a_property_is_looked_for(folder: Path, pretend: Any) -> None:
    def answer(model: Model, checked: list[str]) -> Verdict:
        return ok(model, "depth is 3") if model.cfg == "a" else violated(model, "OneSessionProp")

    ran = pretend(answer)
    one = mutants.generate(folder, ["Tiny"])[:1]
    [outcome] = run(FOUR, one, folder).outcomes
    assert ran == ["a", "c"] and outcome.how == "property"
    assert [(k.model, k.how, k.what) for k in outcome.kills] == [
        ("a", "counts", "depth is 3"),
        ("c", "property", "S-1"),
    ]


@pytest.mark.parametrize(
    ("how", "answer"),
    [
        ("must-fail", lambda m, _: violated(m, "Small") if m.cfg == "b" else ok(m)),
        ("counts", lambda m, _: violated(m, "OneSessionProp") if m.cfg == "b" else ok(m)),
        ("probe", lambda m, _: ok(m, "reached too much") if m.cfg == "d" else ok(m)),
        ("evaluation", lambda m, _: failed(m, "other")),
        ("timeout", lambda m, _: failed(m, "timeout")),
        ("property", lambda m, _: violated(m, "X") if m.cfg == "c" else failed(m, "timeout")),
        ("timeout", lambda m, _: failed(m, "memory")),
        ("counts", lambda m, _: ok(m, "depth") if m.cfg == "a" else failed(m, "timeout")),
        (None, lambda m, _: ok(m)),
    ],
)
def test_how_a_mutant_is_killed(folder: Path, pretend: Any, how: str, answer: Answer) -> None:
    pretend(answer)
    [outcome] = run(FOUR, mutants.generate(folder, ["Tiny"])[:1], folder).outcomes
    assert outcome.how == how


def test_deep_finds_every_property(folder: Path, pretend: Any) -> None:
    def answer(model: Model, checked: list[str]) -> Verdict:
        if model.cfg != "a" or checked == ["OneSessionProp"]:
            return ok(model)
        return violated(model, "Small" if "Small" in checked else None)

    ran = pretend(answer)
    one = mutants.generate(folder, ["Tiny"])[:1]
    [outcome] = run(FOUR, one, folder, profile="deep").outcomes
    assert outcome.properties == ["Live", "Small"]
    assert ran == ["a"] * 4 + ["c", "d"]


def test_a_tool_that_fails_ends_the_run(folder: Path, pretend: Any) -> None:
    pretend(lambda model, _: failed(model, "java"))
    with pytest.raises(mutant_runs.MutationError, match="java"):
        run(FOUR, mutants.generate(folder, ["Tiny"])[:1], folder)


def test_a_model_that_is_wrong_without_a_mutant_ends_the_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(models, "check", lambda model, **_: ok(model, "depth is 3"))
    with pytest.raises(mutant_runs.MutationError, match="tiny is not as expected without a mutant"):
        run([tiny()], mutants.generate(folder, ["Tiny"]), folder)


def test_on_a_slower_machine_a_model_gets_more_time(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def check(model: Model, *, tla_dir: Path, timeout_s: float, **_: object) -> Verdict:
        """One second when it was recorded, thirty here."""
        if timeout_s < 30:
            return failed(model, "timeout")
        mutated = (tla_dir / "Tiny.tla").read_text() != TINY
        verdict = ok(model, "depth is 3" if mutated else None)
        assert verdict.result is not None
        return replace(verdict, result=replace(verdict.result, seconds=30))

    monkeypatch.setattr(models, "check", check)
    [outcome] = run([tiny()], mutants.generate(folder, ["Tiny"])[:1], folder).outcomes
    assert outcome.how == "counts"


def test_what_did_not_end_is_tried_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one, cache = mutants.generate(folder, ["Tiny"])[:1], folder / "cache.jsonl"
    monkeypatch.setattr(models, "check", lambda model, **_: failed(model, "timeout"))
    with pytest.raises(mutant_runs.MutationError, match="without a mutant: timeout"):
        run([tiny()], one, folder, cache=cache)
    monkeypatch.setattr(models, "check", lambda model, **_: ok(model))
    assert run([tiny()], one, folder, cache=cache).outcomes[0].survived


def test_an_interrupted_run_is_incomplete(folder: Path, pretend: Any) -> None:
    pretend(lambda model, _: ok(model))

    def say(text: str) -> None:
        if text.startswith("1 of"):
            raise KeyboardInterrupt

    report = run(FOUR, mutants.generate(folder, ["Tiny"]), folder, say=say)
    assert len(report.outcomes) == 1 and not report.complete and report.exit_code == 4


def entry(mutant: Mutant, **changed: str) -> str:
    fields = {"id": mutant.id, "source": mutant.change, "reason": "Same."} | changed
    return "[[survivor]]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in fields.items())


def test_survivors_must_be_those_listed(folder: Path) -> None:
    every = mutants.generate(folder, ["Tiny"])
    alive, unlisted, killed, edited = every[:4]
    path = folder / survivors.SURVIVORS
    gone = entry(alive, id="Tiny.Gone.guard.0")
    elsewhere = entry(alive, id="Timed.X.guard.0")
    path.write_text(entry(alive) + entry(killed) + entry(edited, source="old") + gone + elsewhere)
    kill = mutant_runs.Kill("tiny", "counts", "depth")
    outcomes = [mutant_runs.Outcome(m, (kill,) if m == killed else ()) for m in every[:4]]
    report = mutant_runs.Report("quick", 4, outcomes)
    problems = survivors.compare(report, survivors.load(folder), every, ["Tiny"])
    assert [text.split(" (")[0] for text in problems] == [
        f"{unlisted.id} survived",
        f"survivors.toml: {edited.id} is {edited.change}".split(" (")[0],
        "survivors.toml lists Tiny.Gone.guard.0, but there is no such mutant",
        f"survivors.toml lists {killed.id}, but it is killed",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('[[survivor]]\nid = "a"\nsource = "b"\n', "needs id, source and reason"),
        ('[[survivor]]\nid = "a"\nsource = "b"\nreason = " "\n', "needs id, source and reason"),
        ('[[survivor]]\nid = "a"\nsource = "b"\nreason = "c"\n' * 2, "lists a twice"),
        ("version = 1\n", "unknown key version"),
        ("[[survivor\n", "line 1"),
    ],
)
def test_a_faulty_list_of_survivors(folder: Path, text: str, message: str) -> None:
    (folder / survivors.SURVIVORS).write_text(text)
    with pytest.raises(ValueError, match=message):
        survivors.load(folder)


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
        ["--module", "Nowhere"],
        ["--model", "nothing", "--limit", "1"],
        ["--only", "Nobody.At.All"],
        ["--write", "--only", "OnAck"],
        ["--limit", "-1"],
    ],
)
def test_the_command_refuses(monkeypatch: pytest.MonkeyPatch, options: list[str]) -> None:
    monkeypatch.setattr(models, "load", lambda: [tiny()])
    assert CliRunner().invoke(app, ["spec", "mutate", *options]).exit_code == 2


def test_the_command_reports(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Each mutant but the last is killed by S-1."""
    wanted = mutants.sample(mutants.generate(), 3)
    kill = mutant_runs.Kill("one_by_two", "property", "S-1")

    def pretended(found: list[Mutant], *_: Any, **__: Any) -> mutant_runs.Report:
        outcomes = [mutant_runs.Outcome(m, (kill,) if m != found[-1] else ()) for m in found]
        return mutant_runs.Report("quick", len(found), outcomes)

    monkeypatch.setattr(mutant_runs, "run", pretended)
    monkeypatch.setattr(models, "load", lambda: [tiny()])
    monkeypatch.setattr(survivors, "load", dict)
    answer = CliRunner().invoke(app, ["spec", "mutate", "--limit", "3"])
    assert answer.exit_code == 1, answer.output
    assert "S-1 2" in answer.output and "66.7%" in answer.output
    assert f"Problem     {wanted[-1].id} survived" in answer.output
    answer = CliRunner().invoke(app, ["spec", "mutate", "--limit", "3", "--json", "-"])
    assert json.loads(answer.output)["properties"]["S-1"] == 2
    monkeypatch.setattr(mutate_commands, "PAGE", tmp_path / "mutation.md")
    assert CliRunner().invoke(app, ["spec", "mutate", "--write"]).exit_code == 1
    page = (tmp_path / "mutation.md").read_text()
    assert "| definition | mutants |" in page and "## Survivors" in page


@pytest.mark.slow
def test_a_mutant_that_only_changes_answers_is_found_in_the_graph(tmp_path: Path) -> None:
    """No model is asked: an answer with a seq differs in the graph of one station."""
    mutant = next(m for m in mutants.generate() if m.operator == "AnswerSeq" and m.kind == "number")
    report = mutant_runs.run([mutant], [], cache=tmp_path / "cache.jsonl", jobs=1)
    (outcome,) = report.outcomes
    assert outcome.how == "graph"
    again = mutant_runs.run([mutant], [], cache=tmp_path / "cache.jsonl", jobs=1)
    assert again.outcomes == report.outcomes
