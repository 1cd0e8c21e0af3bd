"""I-1: the proof that the invariant of Inductive.tla is inductive, and that it can fail."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

z3 = pytest.importorskip("z3", reason="needs the extra prove")

from automcm_maintenance.compilation import sany  # noqa: E402
from automcm_maintenance.compilation.sany import Node, ParsedModules  # noqa: E402
from automcm_maintenance.induction import proof, prove_commands, symbolic  # noqa: E402
from automcm_maintenance.induction.proof import (  # noqa: E402
    EFFORT,
    ENTRIES,
    MESSAGES,
    OF_STATES,
    OF_STEPS,
    ProofResult,
    Prover,
)
from automcm_spec.model_checking import models  # noqa: E402
from automcm_spec.support.collection import uncollected  # noqa: E402
from automcm_spec.vocabulary import reachable_steps  # noqa: E402
from automcm_spec.vocabulary.application import Command, names  # noqa: E402
from automcm_spec.vocabulary.parameters import TIMERS  # noqa: E402
from automcm_spec.vocabulary.rules import RULES  # noqa: E402
from automcm_spec.vocabulary.station import OpenStation, Receive  # noqa: E402

STATION = OpenStation(2, 2, 5, 2, frozenset({2}), frozenset({1}), frozenset({1, 2}))
LIMITS = {
    "MaxRounds": STATION.max_rounds,
    "MaxParticipants": STATION.max_participants,
    "OutboxLimit": STATION.outbox_limit,
    "MemoryLimit": STATION.memory_limit,
}


@pytest.fixture(scope="module", autouse=True)
def _uncollected() -> Iterator[None]:
    with uncollected():
        yield


@pytest.fixture(scope="module")
def spec() -> ParsedModules:
    return sany.read(sany.export("Inductive"))


@pytest.fixture(scope="module")
def ablations() -> ParsedModules:
    return sany.read(sany.export("CutoffAblations"))


def tla(value: Any) -> Any:
    """A value of the compiled station as the evaluator has it."""
    if isinstance(value, frozenset):
        return symbolic.elements(map(tla, value))
    if isinstance(value, tuple):
        if hasattr(value, "_asdict"):
            return {key.rstrip("_"): tla(one) for key, one in value._asdict().items()}
        return tuple(map(tla, value))
    return value


def first_of_each_rule(changed: bool = False) -> dict[str, reachable_steps.Step]:
    """The first step of each rule; ``changed``: which changes the station, if there is one."""
    found: dict[str, reachable_steps.Step] = {}
    for st, i, outcome in reachable_steps.steps(STATION):
        earlier, _, left = found.get(outcome.rule, (None, i, outcome))
        if earlier is None or (changed and left.st == earlier and outcome.st != st):
            found[outcome.rule] = st, i, outcome
    assert found.keys() == RULES.keys() - {"ACT-1", "END-4", "MEM-1"}
    return found


def test_the_evaluator_agrees_with_the_compiled_station(spec: ParsedModules) -> None:
    """On known values all but a test of a size (MEM-1) is decided without z3."""
    evaluator = symbolic.Evaluator(spec, LIMITS)
    for rule, (st, i, outcome) in first_of_each_rule().items():
        found = evaluator.operator("Decide", STATION.me, tla(st), tla(i))
        same = [symbolic.equal(found[key], tla(getattr(outcome, key))) for key in ("st", "out")]
        solver = z3.Solver()
        solver.add(symbolic.lift(symbolic.all_of(same)))
        assert solver.check() == z3.sat, (rule, st, i)


@pytest.mark.slow
def test_it_agrees_if_nothing_is_known(spec: ParsedModules) -> None:
    """The station and a message are variables, and z3 knows that they equal those of the step."""
    prover = Prover(spec)
    evaluator = symbolic.Evaluator(spec, LIMITS, sizes=lambda _: True)  # there was room
    me = z3.Int("me")
    station = prover.station(me)
    for rule, (st, i, outcome) in first_of_each_rule(changed=True).items():
        known, given = [(me, STATION.me), (station, tla(st))], tla(i)
        if isinstance(i, Receive):
            given["message"], _ = symbolic.variables(tla(i.message), "message")
            known.append((given["message"], tla(i.message)))
        found = evaluator.operator("Decide", me, station, given)
        solver = z3.Solver()
        solver.add([symbolic.lift(symbolic.equal(*pair)) for pair in known])
        assert solver.check() == z3.sat
        same = [symbolic.equal(found[key], tla(getattr(outcome, key))) for key in ("st", "out")]
        solver.add(symbolic.lift(symbolic.negated(symbolic.all_of(same))))
        assert solver.check() == z3.unsat, (rule, st, i)


def test_an_unknown_construct_is_refused(spec: ParsedModules) -> None:
    with pytest.raises(sany.NotCompiled, match=r"TLCGet"):
        node = replace(spec.operators["Nobody"].body, op="TLCGet")
        symbolic.Evaluator(spec, LIMITS).value(node, {})


def refuted(
    spec: ParsedModules, step: str, patch: pytest.MonkeyPatch, without: str = ""
) -> ProofResult | None:
    """The first obligation of these steps that z3 refutes. *unknown* is no answer: it tries again
    with another limit, and so on another way."""
    for effort in (1, 2, 3, 5, 8):
        patch.setattr(proof, "EFFORT", effort * EFFORT)
        prover = Prover(spec, frozenset({without} - {""}))
        for result in prover.results(step):
            if result.verdict == "refuted":
                return result
    return None


def test_steps_keep_the_invariant(spec: ParsedModules) -> None:
    results = list(Prover(spec).results("request"))
    assert {r.verdict for r in results} == {"proved"}
    assert {r.goal for r in results} == {*Prover(spec).conjuncts, *OF_STEPS}


def test_no_garbage_is_collected_while_z3_works(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another thread may start a collection, and z3 crashes if it frees what belongs to z3."""
    check, collecting = z3.Solver.check, list[bool]()

    def checked(solver: z3.Solver, *assumptions: Any) -> Any:
        collecting.append(gc.isenabled())
        return check(solver, *assumptions)

    monkeypatch.setattr(z3.Solver, "check", checked)
    gc.enable()
    try:
        prove_commands.run([], "request", lambda text: None)
        assert collecting and not any(collecting) and gc.isenabled()
    finally:
        gc.disable()


@pytest.mark.deep  # the full profile of verify proves it, too
def test_all_is_proved(spec: ParsedModules) -> None:
    report = prove_commands.run([], "", lambda text: None)
    assert report.open == []
    assert {r.goal for r in report.results} == {*Prover(spec).conjuncts, *OF_STEPS, *OF_STATES}
    assert len({r.step for r in report.results}) > 30


STEPS = {
    "restart",
    *(f"receive {kind}" for kind in MESSAGES),
    *(f"command {name}" for name in names(Command)),
    *(f"expire {name}" for name in TIMERS.keys() - {"giveup", "resend"}),
    *(f"expire giveup({kind})" for kind in ENTRIES),
    *(f"expire resend({kind})" for kind in (*ENTRIES, "Advertisement")),
}


def test_every_kind_of_step_is_proved(spec: ParsedModules) -> None:
    assert {kind.name for kind in Prover(spec).transitions()} == STEPS


@pytest.mark.slow
def test_no_obligation_is_vacuous(spec: ParsedModules) -> None:
    """From contradictory hypotheses, or with a guard that never holds, all would be proved.

    z3 finds a state with the invariant, and no contradiction with a step that is possible in it.
    """
    prover = Prover(spec)
    base, verdicts = prover.satisfiable()
    assert base == "refuted"
    assert set(verdicts) == STEPS
    assert "proved" not in verdicts.values(), verdicts


BROKEN_BY = {
    "no_session_number": "receive Fin",
    "no_session_number_crosses": "receive Cancel",
    "no_proposal_number": "receive Acceptance",
    "bare_ack": "receive Ack",
    "ack_from_anybody": "receive Ack",
    "no_busy_refusal": "receive Prescription",
    "busy_overwrites_commitment": "receive Prescription",
    "rejoin": "expire hold",
    "no_quarantine": "restart",
    "retarget": "command prescribe",
    "abandoned_acceptance": "expire giveup(Acceptance)",
    "any_lease_order": "expire lease",
    "cutoff_forgets": "expire forget",
    "no_break_off": "expire cam",
    "own_word_first": "command request",
}
"""The step at which the proof fails if a mechanism is taken away, for each model of Ablations.

``memory_dropped`` is without MayExpire, which the theorem does not assume: for it cutoff_forgets.
"""


def test_each_ablation_is_tried() -> None:
    tried = {m.cfg for m in models.load() if m.module == "Ablations" and m.expect == "violates"}
    assert set(BROKEN_BY) == tried - {"memory_dropped"} | {"cutoff_forgets"}


@pytest.mark.slow
@pytest.mark.parametrize("cfg", BROKEN_BY)
def test_the_proof_fails_without_a_mechanism(
    cfg: str, spec: ParsedModules, ablations: ParsedModules, monkeypatch: pytest.MonkeyPatch
) -> None:
    [config] = [model.config for model in models.load() if model.cfg == cfg]
    operators = {**ablations.operators, **spec.operators}
    operators |= {name: operators[other] for name, other in models.replaced_in(config).items()}
    assert refuted(replace(spec, operators=operators), BROKEN_BY[cfg], monkeypatch)


ORDERS = [
    ("InOrder", 0, "expire lease"),
    ("InOrder", 1, "expire forget"),
    ("InOrder", 1, "expire quarantine"),
    ("InOrder", 2, "expire quarantine"),
    ("DiesInOrder", 0, "expire forget"),
    ("DiesInOrder", 1, "expire quarantine"),
]
"""Each part of what T-4 and T-5 say, by its place, and the step at which the proof fails without
it."""


def without_part(node: Node, n: int) -> Node:
    """The first list of conjuncts or disjuncts without one of them."""
    if node.op in ("$ConjList", "$DisjList"):
        return replace(node, args=tuple(arg for k, arg in enumerate(node.args) if k != n))
    return replace(node, args=(*node.args[:-1], without_part(node.args[-1], n)))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "n", "step"), ORDERS)
def test_the_proof_fails_without_a_part_of_the_orders(
    name: str, n: int, step: str, spec: ParsedModules, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = spec.operators[name]
    operators = {**spec.operators, name: replace(found, body=without_part(found.body, n))}
    assert refuted(replace(spec, operators=operators), step, monkeypatch)


NEEDED_AT = {
    "TypeInv": "receive Ack",
    "OpenedInv": "command request",
    "RoleInv": "expire decide",
    "NewestInv": "expire forget",
    "FormInv": "receive Advertisement",
    "OutboxInv": "expire resend(Cancel)",
    "OwnEntriesInv": "receive Ack",
    "AdvertisedInv": "expire resend(Advertisement)",
    "QuarantineInv": "",
    "RecordedInv": "command prescribe",
    "PrescribedInv": "command prescribe",
    "CancelledInv": "receive Fin",
    "ReceiverInv": "command accept",
    "CommittedInv": "command prescribe",
    "RefusedInv": "receive Ack",
    "AckedInv": "receive Ack",
    "HeededInv": "expire quarantine",
    "BeenInv": "expire quarantine",
    "ActsOnInv": "",
    "ReliedInv": "",
    "OneReliesInv": "",
}
"""The step at which the rest of the invariant is not kept without a conjunct; "": in one state."""


def test_each_conjunct_is_tried(spec: ParsedModules) -> None:
    assert list(NEEDED_AT) == Prover(spec).conjuncts


@pytest.mark.slow
@pytest.mark.parametrize("name", NEEDED_AT)
def test_the_proof_fails_without_a_conjunct(
    name: str, spec: ParsedModules, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert refuted(spec, NEEDED_AT[name], monkeypatch, without=name)
