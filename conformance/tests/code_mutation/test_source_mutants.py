"""Each check can fail: ten changes to the reference, and as many edits of the specification.

A change is applied to a copy.  The comparison must name the rule that was touched; of the
specification's edits it must find a difference (neither the hash nor drift counts).
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from automcm_maintenance.verify.graph_comparison import walk
from automcm_maintenance.verify.spec_mapping import Reference
from automcm_spec.graph import oracle_generation
from automcm_spec.graph.oracle import dump, parse
from automcm_spec.support.paths import TLA

ROOT = Path(__file__).resolve().parents[3]
REFERENCE = ROOT / "reference" / "automcm"

WALK = """
from automcm_maintenance.verify.spec_mapping import Reference
from automcm_maintenance.verify.graph_comparison import walk
from automcm_spec.graph import oracle, oracle_generation
graph = oracle.load(oracle_generation.ONE_PEER.path)
found = walk(graph, Reference(graph.constants), stop_at_first=True).divergences
print(found[0].rule if found else "no difference")
"""

CODE = {
    "the busy refusal is gone": (
        "negotiating.py",
        "foreign(me, st, i) and st.bound",
        "False",
        "NEG-4",
    ),
    "a session may be joined again": (
        "advertising.py",
        "[1] <= st.joined",
        "[1] < st.joined",
        "ADV-8",
    ),
    "the seq of an Ack is not checked": (
        "ending.py",
        "entry.session, entry.seq) == named",
        "entry.session, m.of.seq) == named",
        "END-6",
    ),
    "the hold timer is not armed": ("state.py", 'case "WAITING":', 'case "":', "ADV-6"),
    "the proposal of an Acceptance is not checked": (
        "negotiating.py",
        "m.proposal == st.proposal)",
        "m.proposal <= st.proposal)",
        "NEG-6",
    ),
    "one proposal too many": (
        "negotiating.py",
        "st.proposal < me.max_rounds",
        "st.proposal <= me.max_rounds",
        "NEG-7",
    ),
    "any CAM counts": ("actuating.py", "and st.session in m.marks", "", "ACT-5"),
    "copies of a Prescription are not acked": (
        "negotiating.py",
        '    Row("NEG-1", lambda me, st, i: i.message.proposal <= st.proposal, acked),',
        '    Row("NEG-1", lambda me, st, i: i.message.proposal <= st.proposal, '
        "lambda me, st, i: Outcome(st)),",
        "NEG-1",
    ),
    "no back-off": ("prescribing.py", "backoff=True", "backoff=False", "PRE-1"),
    "an echo of the own message is taken": (
        "ending.py",
        "if m.src == me.station_id or (m.dst",
        "if (m.dst",
        "END-5",
    ),
    "Fin is not sent reliably": (
        "actuating.py",
        "return leave_with(st, [fin])",
        "return Outcome(leave(st), (fin,))",
        "ACT-3",
    ),
    "the lease of the prescriber is not armed": (
        "state.py",
        "timers = [LEASE]",
        "timers = []",
        "PRE-2",
    ),
}


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    "what",
    [pytest.param(w, marks=[pytest.mark.deep] * (w == "one proposal too many")) for w in CODE],
)
def test_a_change_to_the_reference_is_named(what: str, tmp_path: Path) -> None:
    file, old, new, rule = CODE[what]
    shutil.copytree(REFERENCE, tmp_path / "automcm")
    module = tmp_path / "automcm" / "core" / file
    text = module.read_text()
    assert text.count(old) == 1, "the change no longer applies"
    module.write_text(text.replace(old, new))
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    answer = subprocess.run(
        [sys.executable, "-c", WALK], env=environment, capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == rule


TINY = oracle_generation.Graph("tiny", (2,), 1, 1, 2, 3, 1)

SPEC = {
    "a withdrawn station is acked": (
        "p \\in st.withdrawn THEN AnswerClosed(me, st, m,",
        "p \\in st.withdrawn THEN Answer(st, Ack(me, m),",
    ),
    "waiting ends as an abort": (
        '<<"fallback", "timeout">>, "ADV-7"',
        '<<"fallback", "abort">>, "ADV-7"',
    ),
    "copies are verified again": ("OlderOrSame(k, l)  == k <= l", "OlderOrSame(k, l)  == k < l"),
    "an Ack counts for anything": ("m.of = <<e.type, e.seq>>", "TRUE"),
    "busy is said to be unknown": (
        'RefusalAnswer(me, m, "busy")',
        'RefusalAnswer(me, m, "unknown_session")',
    ),
    "an Acceptance outlives its session": (
        '{e \\in @ : e.type \\in {"Fin", "Cancel"}} ]',
        '{e \\in @ : e.type \\in {"Fin", "Cancel", "Acceptance"}} ]',
    ),
    "a Fin is not acked": (
        'Effect(Leave(st), {Ack(me, m)}, <<"finished">>',
        'Effect(Leave(st), {}, <<"finished">>',
    ),
    "no quarantine": ("number, !.quarantine = TRUE]", "number, !.quarantine = FALSE]"),
    "one proposal too many": ("== st.proposal < MaxRounds", "== st.proposal <= MaxRounds"),
    "a late CAM counts": ("(i.newer \\/ ~st.heard)", "TRUE"),
    "no cam timer": ('If(st.phase = "ACTUATING", {Timer("cam")})', 'If(FALSE, {Timer("cam")})'),
    "an answer has a seq": ("AnswerSeq(seq)         == 0", "AnswerSeq(seq)         == seq"),
}


def differences(tla: Path) -> int:
    """How much the reference differs from the specification in a folder, where it first does."""
    try:
        data, _ = oracle_generation.build(TINY, tla=tla, workers=1, short=True)
    except ValueError as error:  # the type invariant
        assert "TypeInv" in str(error)
        return 1
    oracle = parse(dump(data), "tiny")
    return walk(oracle, Reference(oracle.constants), stop_at_first=True).differences


@pytest.mark.slow
def test_unchanged_there_is_no_difference() -> None:
    assert differences(TLA) == 0


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    "what", [pytest.param(w, marks=[pytest.mark.deep] * (n % 3 > 0)) for n, w in enumerate(SPEC)]
)
def test_an_edit_of_the_specification_is_noticed(what: str, tmp_path: Path) -> None:
    old, new = SPEC[what]
    for path in TLA.glob("*.tla"):
        shutil.copy(path, tmp_path)
    text = (tmp_path / "Station.tla").read_text()
    assert text.count(old) == 1, "the edit no longer applies"
    (tmp_path / "Station.tla").write_text(text.replace(old, new))
    assert differences(tmp_path) > 0
