"""The certificate of the kit: mutants are made, told from the reference, and judged rightly."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from cli_stage import automcm

from automcm_conformance.suite import purposes
from automcm_conformance.suite.purposes import Purpose
from automcm_maintenance.code_mutation import (
    certificate,
    certificate_page,
    equivalence,
    lockstep,
    source_mutants,
    suite_kills,
)
from automcm_maintenance.code_mutation.certificate import CertificateRun, KillCertificate, MutantRow
from automcm_maintenance.code_mutation.equivalence import Difference
from automcm_maintenance.code_mutation.faults import Edit
from automcm_maintenance.code_mutation.mutated_process import NO_IMPORT, full_name
from automcm_maintenance.code_mutation.source_edits import CLASSES
from automcm_maintenance.code_mutation.source_mutants import (
    SHARE,
    Generated,
    SourceMutant,
    generate,
    path_of,
    sample,
)
from automcm_maintenance.code_mutation.station_behaviour import VARIANTS, AnyState
from automcm_maintenance.code_mutation.suite_kills import Kills
from automcm_spec.graph.oracle import load
from automcm_spec.graph.oracle_generation import GRAPHS

TIGHT = (("tight", 0),)


@pytest.fixture(scope="module")
def made() -> Generated:
    return generate(modules=["state", "phases", "prescribing", "actuating", "ending", "messages"])


def changed(module: str, old: str, new: str) -> SourceMutant:
    """A mutant made by hand."""
    source = path_of(module).read_text(encoding="utf-8")
    mutated = Edit(full_name(module), old, new).apply(source)
    line = source[: source.index(old)].count("\n") + 1
    return SourceMutant(f"{module}/by hand/guard-1", "guard", module, line, "", old, new, mutated)


@pytest.mark.slow
def test_the_same_mutants_come_each_time(made: Generated) -> None:
    again = generate(modules=["state", "ending"])
    assert again.mutants == [m for m in made.mutants if m.module in ("state", "ending")]
    chosen = sample(made.mutants, SHARE, 1)
    assert chosen == sample(list(made.mutants), SHARE, 1)
    assert {m.id for m in chosen} != {m.id for m in sample(made.mutants, SHARE, 2)}
    assert sample(made.mutants, 0, 1) == made.mutants


@pytest.mark.slow
def test_there_are_enough_of_each_class() -> None:
    made = generate()
    assert len(made.mutants) >= len(sample(made.mutants, SHARE, 1)) >= 150
    classes = Counter(m.class_ for m in sample(made.mutants, SHARE, 1))
    assert set(classes) == set(CLASSES) and min(classes.values()) >= 20
    assert len({m.id for m in made.mutants}) == len(made.mutants)
    assert len({(m.module, m.source) for m in made.mutants}) == len(made.mutants)
    for m in made.mutants:
        assert re.fullmatch(r"[a-z]+/\w+/[a-z]+-\d+", m.id)
        assert m.rule and m.old != m.new


def test_a_name_that_names_nothing_is_an_error() -> None:
    sources = [path_of(module).read_text(encoding="utf-8") for module in source_mutants.MODULES]
    assert source_mutants.unnamed(sources) == set()
    for name in ("_rearm", "cancel_peer", "MACHINES", "backoff_min"):
        renamed = [re.sub(rf"\b{name}\b", "renamed", source) for source in sources]
        assert source_mutants.unnamed(renamed) == {name}


SCRIPTS = {
    "table": (
        "actuating",
        '"ACT-3", from_own_prescriber, finished',
        '"ACT-3", from_own_prescriber, acked',
    ),
    "guard": (
        "advertising",
        'st.bound, refuse),\n    Row("ACT-6"',
        'False, refuse),\n    Row("ACT-6"',
    ),
    "timer": (
        "parameters",
        '(p["t_timeout"] // p["t_resend"] + 1)',
        '(p["t_timeout"] // p["t_resend"])',
    ),
    "field": ("advertising", "seq=1,\n        scenario", "seq=2,\n        scenario"),
    "memory": ("advertising", "number=st.number + 1,\n", "\n"),
    "form": ("messages", "Field(ge=1, le=2**32 - 1)", "Field(ge=0, le=2**32 - 1)"),
}
PARAMETERS = {
    **{"t_timeout": 300, "t_resend": 100, "t_decide": 500, "t_cam_loss": 1500, "t_cam": 1000},
    **{"backoff_min": 5, "backoff_max": 5, "max_rounds": 3, "max_participants": 2},
    **{"outbox_limit": 8, "memory_limit": 8},
}
REQUEST = {"name": "request", "scenario": "lane_change", "details": {}}
FIN = {"v": 1, "type": "Fin", "src": 9, "dst": 1, "session": [9, 1], "seq": 3}
LINES = [
    {"cmd": "hello", "protocol": 1},
    {"cmd": "reset", "now": 0, "station": 1, "parameters": PARAMETERS, "seed": 1},
    {"cmd": "receive", "now": 1, "message": FIN},
    {"cmd": "receive", "now": 1, "message": FIN | {"src": 0}},
    {"cmd": "command", "now": 2, "command": REQUEST},
    {"cmd": "command", "now": 3, "command": REQUEST},
    {"cmd": "advance", "now": 399},
    {"cmd": "advance", "now": 1000},
    {"cmd": "command", "now": 2000, "command": REQUEST},
    {"cmd": "stop"},
]


def ended(module: str, file: str) -> subprocess.CompletedProcess[str]:
    lines = "".join(json.dumps(line) + "\n" for line in LINES)
    command = [
        sys.executable,
        "-m",
        "automcm_maintenance.code_mutation.mutated_process",
        module,
        file,
    ]
    return subprocess.run(command, input=lines, capture_output=True, text=True)


def said(module: str, file: str) -> str:
    done = ended(module, file)
    done.check_returncode()
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("class_", [c for c in SCRIPTS if c != "table"])
def test_a_mutated_child_answers_differently(class_: str, tmp_path: Path) -> None:
    module, old, new = SCRIPTS[class_]
    file = tmp_path / "source.py"
    file.write_text(changed(module, old, new).source, encoding="utf-8")
    right, wrong = said("state", "-"), said(module, str(file))
    assert right.count("\n") == wrong.count("\n") == len(LINES) - 1
    assert right != wrong


def test_a_child_that_computes_without_end_is_ended(tmp_path: Path) -> None:
    file = tmp_path / "source.py"
    loop = changed("station", "effects.append(self._step(Expiry(", "pass; ((Expiry(")
    file.write_text(loop.source, encoding="utf-8")
    done = ended("station", str(file))
    assert done.returncode == -signal.SIGPROF and 0 < done.stdout.count("\n") < len(LINES) - 1


def test_what_does_not_import_is_told_from_what_is_wrong(tmp_path: Path) -> None:
    file = tmp_path / "source.py"
    file.write_text("1 / 0")
    command = [
        sys.executable,
        "-m",
        "automcm_maintenance.code_mutation.mutated_process",
        "state",
        str(file),
    ]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert done.returncode == NO_IMPORT and "ZeroDivisionError" in done.stderr


def walked(mutant: SourceMutant, folder: Path) -> Difference | None:
    file = folder / "source.py"
    file.write_text(mutant.source, encoding="utf-8")
    found = equivalence.first_difference(mutant, file, TIGHT)
    return None if found is None else found.difference


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
    module, old, new = SCRIPTS["table"]
    found = walked(changed(module, old, new), tmp_path)
    assert found is not None and found.graph == "tight"
    assert '"Fin"' in found.input and found.state[1] == "receiver"
    assert "finished" in found.right and "finished" not in found.wrong


@pytest.mark.parametrize(
    ("first", "quick", "parts"),
    [
        (["ACT-3"], False, [(1, False), (0, True), (0, False)]),
        ([], False, [(0, True), (0, False)]),
        (["ACT-3"], True, [(0, True)]),
    ],
)
def test_what_is_run_until_a_case_fails(
    first: list[str],
    quick: bool,
    parts: list[tuple[int, bool]],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    """First the likely cases (1), then the quick part of all (0), then all; or that part alone."""
    ran: list[tuple[int, bool]] = []

    def kills(
        command: object, graphs: object, part: list[Purpose], *_: object, **how: Any
    ) -> Kills:
        ran.append((int(len(part) < len(purposes.load())), how["quick"]))
        return Kills()

    monkeypatch.setattr(suite_kills, "kills", kills)
    monkeypatch.setattr(certificate, "_graphs", lambda: None)
    certificate.killed(["no"], CertificateRun(tmp_path, quick=quick), tmp_path, first)
    assert ran == parts
    kept = certificate.suite_hash(CertificateRun(tmp_path, quick=quick))
    assert (kept == certificate.suite_hash(CertificateRun(tmp_path))) is not quick


def test_a_changed_walk_makes_earlier_verdicts_invalid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    walk = tmp_path / "walk.py"
    monkeypatch.setattr(equivalence, "FILES", (walk,))
    found = set()
    for text in ("one", "other"):
        walk.write_text(text)
        found.add(certificate.suite_hash(CertificateRun(tmp_path)))
    assert len(found) == 2


def test_a_walk_without_end_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(equivalence, "SECONDS", 0)
    with pytest.raises(equivalence.EquivalenceError, match="no end after 0 s"):
        walked(changed(*SCRIPTS["table"]), tmp_path)


@pytest.mark.slow
def test_survivors_count_and_are_shown(tmp_path: Path) -> None:
    """A suite that cannot see a mutant, and one that can."""
    mutant = changed(*SCRIPTS["table"])
    blind = CertificateRun(tmp_path, selectors=("AMCM/STA/REL/TI-01",), jobs=1, walks=TIGHT)
    for _ in range(2):  # the second time from what was kept
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


def of(*rows: MutantRow, chosen: int = 2) -> KillCertificate:
    asked = CertificateRun(Path(), seed=7)
    return KillCertificate(asked, "ab" * 32, Generated([]), chosen, list(rows))


KILLED = MutantRow(
    "state/armed/timer-1", "timer", "reference/automcm/core/state.py", 9, "ACT-5", "a | b", "a"
)


def test_the_exit_code_says_what_is_left() -> None:
    killed = replace(KILLED, verdict="killed", cases=["AMCM/PRE/ACT/TI-01"])
    equal = replace(KILLED, verdict="equivalent")
    assert of(killed, equal).exit_code == 0
    assert of(killed, replace(KILLED, verdict="survived")).exit_code == 1
    assert of(killed, replace(KILLED, verdict="undecided")).exit_code == 1
    assert of(killed).exit_code == 3, "not complete"
    stopped = of(killed, equal)
    stopped.problems.append("interrupted")
    assert stopped.exit_code == 3 and not stopped.complete


def test_an_interrupted_run_returns_what_is_decided_and_continues(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Interrupted when one mutant is killed, and one could not be judged."""
    first, second = changed(*SCRIPTS["table"]), changed(*SCRIPTS["guard"])

    verdicts = iter(("killed", "undecided"))

    def judge(asked: CertificateRun, values: Any) -> Any:
        if (verdict := next(verdicts, None)) is None:
            raise KeyboardInterrupt
        return replace(KILLED, id=values["id"], verdict=verdict).as_dict()

    monkeypatch.setattr(certificate, "_judge", judge)
    third = changed(*SCRIPTS["timer"])
    asked = CertificateRun(tmp_path, jobs=1, walks=())
    rows, problems = certificate.run([first, second, third], asked, lambda text: None)
    assert [row.id for row in rows] == [first.id] and problems == ["interrupted"]
    assert len(list((tmp_path / "cells").iterdir())) == 1, "what is undecided is judged again"
    rows, problems = certificate.run([first], asked, lambda text: None)
    assert [row.verdict for row in rows] == ["killed"] and problems == []


@pytest.mark.parametrize("ends", [None, "forms", "one-peer", "two-peers"])
def test_only_who_is_compared_on_every_graph_is_equivalent(
    ends: str | None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A comparison that breaks off leaves a mutant that no case kills undecided."""
    walked: list[tuple[str, int]] = []

    def first_difference(_: object, __: object, walks: Any) -> None:
        walked.extend(walks)
        if ends in {graph for graph, _ in walks}:
            raise equivalence.EquivalenceError("no end")

    monkeypatch.setattr(equivalence, "first_difference", first_difference)
    monkeypatch.setattr(certificate, "killed", lambda *_: Kills())
    monkeypatch.setattr(certificate, "_graphs", lambda: None)
    asked, values = CertificateRun(tmp_path), asdict(changed(*SCRIPTS["table"]))
    row = MutantRow.of(certificate._judge(asked, values))
    if ends is None:
        assert row.verdict == "equivalent" and sorted(walked) == sorted(equivalence.WALKS)
    else:
        assert row.verdict == "undecided" and row.why == "no end"


def test_the_parts_of_the_suite_end_with_a_kill_and_share_one_limit(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    parts = iter((Kills(), Kills(["AMCM/STA/END/BI-04"])))
    left: list[float] = []

    def kills(*_: object, until_s: float, **__: object) -> Kills:
        left.append(until_s)
        return next(parts)

    monkeypatch.setattr(suite_kills, "kills", kills)
    monkeypatch.setattr(certificate, "_graphs", lambda: None)
    found = certificate.killed(["no"], CertificateRun(tmp_path), tmp_path, ["ACT-3"])
    assert found.cases == ["AMCM/STA/END/BI-04"]
    assert certificate.UNTIL_S >= left[0] > left[1] and len(left) == 2


def test_the_page_is_made_of_the_certificate() -> None:
    killed = replace(KILLED, verdict="killed", cases=["AMCM/PRE/ACT/TI-01", "AMCM/STA/REL/TI-02"])
    difference = Difference("tight", ["STANDALONE"], '["restart"]', "one", "other")
    survived = replace(KILLED, id="state/key/field-1", class_="field", verdict="survived")
    survived.difference = difference
    found = json.loads(json.dumps(of(killed, survived).as_dict()))
    text = certificate_page.markdown(found)
    assert "| timer | 1 | 1 | 0 | 0 | 0 | 0 |" in text
    assert "| class | mutants | ACT | REL |" in text and "| timer | 1 | 1 | 1 |" in text
    assert "`a \\| b  =>  a` | PRE/ACT/TI-01, STA/REL/TI-02 |" in text
    assert "right one" in text and "wrong other" in text and "seed 7" in text


def test_usage(made: Generated, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source_mutants, "generate", lambda: made)
    for bad in (["--class", "odd"], ["--mutant", "no/such/one-1"], ["--station", "moon"]):
        assert automcm("conform", "certify", *bad).exit_code == 2
    listed = automcm("conform", "certify", "--list", "--class", "form")
    assert listed.exit_code == 0 and "messages/" in listed.output
    assert "state/" not in listed.output


def of_id(made: Generated, id_: str) -> SourceMutant:
    (mutant,) = [each for each in made.mutants if each.id == id_]
    return mutant


def test_an_output_at_an_input_that_no_graph_has_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    walker = AnyState(load(GRAPHS["tight"].path), VARIANTS[0])
    monkeypatch.setitem(walker._extra, "all timers, later", list)
    with lockstep.unchanged("tight", "0") as right:
        found = lockstep.first_difference(walker, right)
    assert found is not None and found.outcomes[0][0] == "all timers, later"


@pytest.mark.slow
def test_what_is_kept_and_never_said_is_equivalent(made: Generated, tmp_path: Path) -> None:
    """Who has withdrawn is of no use once the choice has begun (ADV-5)."""
    assert walked(of_id(made, "prescribing/window_closes/memory-1"), tmp_path) is None


@pytest.mark.slow
def test_what_is_kept_and_said_later_is_not(made: Generated, tmp_path: Path) -> None:
    """Who withdraws, and stays recorded all the same, is acked again (END-2)."""
    assert walked(of_id(made, "ending/withdraw/memory-4"), tmp_path) is not None
