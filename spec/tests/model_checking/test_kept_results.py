"""Results of TLC that are kept: which change has a model run again, and which does not."""

import os
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
from model_stage import LISTED

from automcm_spec.model_checking import kept_results, models, tlc, toolchain
from automcm_spec.model_checking.models import Model, ModelVerdict
from automcm_spec.model_checking.tla_values import Function, Record
from automcm_spec.model_checking.tlc import TlcError, TlcResult, TraceState
from automcm_spec.support.paths import TLA

RUN = tlc.run
NAMES = ("bare_ack", "one_by_two", "two_by_one", "drift")
"""A must-fail model, and three of modules of which one only reads Coordination or Drift."""
STATE = r"""/\ set = {1, 2, "a"}
/\ record = [ok |-> TRUE, next |-> <<1, <<>>, "Ω\n">>]
/\ function = ("a b" :> 1 @@ 2 :> {})
"""


def printed(model: Model, on_print: Callable[[str], None]) -> TlcResult:
    """As expected."""
    for label in model.reaches or ():
        on_print(f'"<<\\"REACHED\\", \\"{label}\\">>"')
    if model.expect == "holds":
        counts = model.distinct_states or 0, model.states or 0, model.depth or 0
        return TlcResult("holds", None, *counts, 1.5)
    trace = [TraceState(1, "Initial predicate", "/\\ x = 0")]
    trace += [TraceState(n, "Next", STATE) for n in range(2, (model.length or 0) + 1)]
    return TlcResult("violates", model.breaks, 10, 20, 3, 0.25, tuple(trace), loop=2)


@dataclass
class Runs:
    """Runs of the models in copies of the specification, and for which of them TLC was started."""

    folder: Path
    ran: list[str] = field(default_factory=list)
    chosen: list[Model] = field(default_factory=lambda: [LISTED[name] for name in NAMES])
    answer: Callable[[Model, Callable[[str], None]], TlcResult] = printed

    @property
    def tla(self) -> Path:
        return self.folder / "tla"

    @property
    def results(self) -> Path:
        return self.folder / "runs" / "kept"

    def tlc(self, module: str, cfg: Path, **options: Any) -> TlcResult:
        self.ran.append(cfg.stem)
        (model,) = (model for model in self.chosen if model.cfg == cfg.stem)
        return self.answer(model, options["on_print"])

    def again(self, **options: Any) -> set[str]:
        """The models for which TLC is started."""
        self.ran.clear()
        self.verdicts(**options)
        return set(self.ran)

    def verdicts(self, **options: Any) -> dict[str, ModelVerdict]:
        found: list[ModelVerdict] = []
        kept_results.check_all(
            self.chosen, self.results, on_done=found.append, tla_dir=self.tla, **options
        )
        return {verdict.model.cfg: verdict for verdict in found}


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Runs:
    shutil.copytree(TLA, tmp_path / "tla")
    made = Runs(tmp_path)
    monkeypatch.setattr(tlc, "run", made.tlc)
    return made


def test_a_model_is_run_once_and_its_verdict_stays(runs: Runs) -> None:
    first = runs.verdicts()
    assert sorted(runs.ran) == sorted(NAMES) and not any(v.kept for v in first.values())
    runs.ran.clear()
    second = runs.verdicts()
    assert second == {name: replace(verdict, kept=True) for name, verdict in first.items()}
    assert runs.ran == []
    state = second["bare_ack"].trace[1]
    assert [type(value) for value in state.values.values()] == [frozenset, Record, Function]
    assert state.text == STATE and state.values["record"]["ok"] is True  # type: ignore[index]
    assert runs.again(fresh=True) == set(NAMES) and runs.again() == set()


def append(path: Path) -> None:
    path.write_bytes(path.read_bytes() + b" ")


def entry(runs: Runs, name: str, **changes: object) -> None:
    (n,) = (n for n, model in enumerate(runs.chosen) if model.cfg == name)
    runs.chosen[n] = runs.chosen[n].model_copy(update=changes)


CHANGES: dict[str, tuple[Callable[[Runs], object], set[str]]] = {
    "nothing": (lambda r: None, set()),
    "an extended module": (lambda r: append(r.tla / "Station.tla"), set(NAMES)),
    "an instance": (lambda r: append(r.tla / "Coordination.tla"), {"two_by_one"}),
    "its own module": (lambda r: append(r.tla / "Drift.tla"), {"drift"}),
    "a module of none of them": (lambda r: append(r.tla / "Attacker.tla"), set()),
    "a module in the place of a standard one": (
        lambda r: (r.tla / "Naturals.tla").write_text("---- MODULE Naturals ----\n===="),
        set(NAMES),
    ),
    "a cfg": (lambda r: entry(r, "bare_ack", config="INIT Init"), {"bare_ack"}),
    "the length expected": (lambda r: entry(r, "bare_ack", length=9), {"bare_ack"}),
    "the states expected": (lambda r: entry(r, "one_by_two", states=9), {"one_by_two"}),
    "what is to be reached": (lambda r: entry(r, "drift", reaches=["x"]), {"drift"}),
    "the options, by the seconds": (lambda r: entry(r, "drift", seconds=99.0), {"drift"}),
}


@pytest.mark.sweep(5)
@pytest.mark.parametrize("what", CHANGES)
def test_a_change_has_the_models_run_again_that_depend_on_it(what: str, runs: Runs) -> None:
    runs.verdicts()
    change, wanted = CHANGES[what]
    change(runs)
    assert runs.again() == wanted
    assert runs.again() == set()


def test_another_tlc_java_or_code_has_all_run_again(
    runs: Runs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jar, java = tmp_path / "tlc.jar", tmp_path / "java" / "bin" / "java"
    java.parent.mkdir(parents=True)
    jar.write_bytes(b"TLC")
    release = tmp_path / "java" / "release"
    release.write_text('JAVA_VERSION="25"')
    monkeypatch.setattr(tlc, "tools", lambda: (java, jar))
    assert runs.again() == set(NAMES) and runs.again() == set()
    append(jar)
    assert runs.again() == set(NAMES) and runs.again() == set()
    append(release)
    assert runs.again() == set(NAMES) and runs.again() == set()
    monkeypatch.setenv("JAVA_TOOL_OPTIONS", "-Dtlc2.tool.fp.FPSet.impl=x")
    assert runs.again() == set(NAMES) and runs.again() == set()
    for module in (models, tlc, kept_results):
        assert module in kept_results.CODE
    monkeypatch.setattr(kept_results, "CODE", kept_results.CODE[1:])
    assert runs.again() == set(NAMES) and runs.again() == set()
    release.unlink()
    assert runs.again() == set(NAMES) == runs.again()  # nothing is known of that Java


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


DAMAGE: dict[str, Callable[[Path], object]] = {
    "empty": lambda p: p.write_bytes(b""),
    "cut": lambda p: p.write_bytes(p.read_bytes()[:-1]),
    "a bit": flip,
    "no result": lambda p: p.write_text("0" * 64 + "\n{}"),
    "of another model": lambda p: shutil.copy(p.with_name("drift.result"), p),
}


@pytest.mark.sweep(3)
@pytest.mark.parametrize("what", DAMAGE)
def test_a_damaged_file_is_no_result(what: str, runs: Runs) -> None:
    runs.verdicts()
    DAMAGE[what](runs.results / "one_by_two.result")
    assert runs.again() == {"one_by_two"}
    assert runs.again() == set()


def test_a_result_from_elsewhere_is_judged_by_the_model(runs: Runs) -> None:
    """Even with the right digest: a result that is not as expected is none."""
    wrong = replace(runs.verdicts()["one_by_two"], reached=("a thing",))
    key = kept_results._key(wrong.model, runs.tla)
    assert key is not None
    kept_results._write(wrong, key, runs.results)
    assert runs.again() == {"one_by_two"}


def other_count(model: Model, on_print: Callable[[str], None]) -> TlcResult:
    return replace(printed(model, on_print), distinct_states=1, trace=())


def violates(model: Model, on_print: Callable[[str], None]) -> TlcResult:
    return replace(printed(model, on_print), outcome="violates", property="AnotherInv")


def breaks_off(model: Model, on_print: Callable[[str], None]) -> TlcResult:
    raise TlcError("memory", "TLC ran out of memory")


@pytest.mark.parametrize("answer", [other_count, violates, breaks_off])
def test_only_what_is_as_expected_is_kept(
    answer: Callable[[Model, Callable[[str], None]], TlcResult], runs: Runs
) -> None:
    runs.answer = answer
    assert not any(verdict.ok for verdict in runs.verdicts().values())
    assert runs.again() == set(NAMES) and not runs.results.exists()
    runs.answer = printed
    assert runs.again() == set(NAMES) and runs.again() == set()
    runs.answer = answer
    assert not any(verdict.ok for verdict in runs.verdicts(fresh=True).values())


def test_what_changes_while_tlc_runs_is_not_kept(runs: Runs) -> None:
    def edited(model: Model, on_print: Callable[[str], None]) -> TlcResult:
        append(runs.tla / "Station.tla")
        return printed(model, on_print)

    runs.answer = edited
    assert runs.again() == set(NAMES) and not runs.results.exists()
    runs.answer = printed
    assert runs.again() == set(NAMES) and runs.again() == set()


@pytest.mark.slow
def test_the_modules_of_the_hash_are_those_that_tlc_reads(tmp_path: Path) -> None:
    texts = {path.stem: path.read_text() for path in TLA.glob("*.tla")}
    program = [toolchain.java(), f"-Djava.io.tmpdir={tmp_path}", "-cp", toolchain.tla2tools()]
    done = subprocess.run(
        [*program, "tla2sany.SANY", *(f"{name}.tla" for name in texts)],
        cwd=TLA,
        capture_output=True,
        text=True,
        check=True,
    )
    parts = done.stdout.split("****** SANY2 ")[1:]
    assert len(parts) == len(texts)
    for name, part in zip(texts, parts, strict=True):
        read = re.findall(rf"Parsing file {re.escape(str(TLA) + os.sep)}(\w+)\.tla", part)
        assert read[0] == name and set(read) == models.extended(name, texts, instances=True)
