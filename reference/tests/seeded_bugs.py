"""Bugs to be found: each a small change to the reference, made while a machine runs.

A change of the tables is handed to the stations; what no table holds is patched for the time
being.  With ``what`` a property only that is looked at (the oracle would be quicker); else it is
the rule by which the oracle notices.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unittest import mock

from stateful import Call, Coordination, profile, run, shortened
from stateful_oracle import ALL, PROPERTIES, Broken

from automcm.core import station
from automcm.core.advertising import answer_closed
from automcm.core.outcome import Me, Outcome, Rules, leave
from automcm.core.rules import RULES
from automcm.core.state import State, Timer, armed
from automcm_evaluation.safety.ablations import (
    ack_misread,
    any_cam,
    bound_session,
    changed,
    free_at_once,
    lease_anew,
    never,
    take_over,
)
from automcm_maintenance.verify.spec_mapping import without
from automcm_spec.vocabulary.messages import Ack, Cancel, Prescription


def give_up_and_leave(me: Me, st: State, i: Any) -> Outcome:
    return Outcome(leave(st) if st.phase == "ACTUATING" else st._replace(outbox=()))


def instruct_all(me: Me, st: State, i: Any) -> Outcome:
    """The Prescription goes to every recorded station."""
    (outcome,) = [row.then(me, st, i) for row in RULES["command prescribe"][2:3]]
    (proposal,) = [m for m in outcome.messages if isinstance(m, Prescription)]
    sent = tuple(
        proposal.model_copy(update={"dst": m.dst, "seq": m.seq}) if isinstance(m, Cancel) else m
        for m in outcome.messages
    )
    return outcome._replace(messages=sent)


def acked_by_anybody(st: State, m: Ack) -> Any:
    named = m.of.type, m.session, m.of.seq
    return next((e for e in st.outbox if (e.type, e.session, e.seq) == named), None)


def always_closed(me: Me, st: State, i: Any) -> Outcome:
    return answer_closed(me, st._replace(outbox=()), i)


def other_content(me: Me, st: State, i: Any) -> Outcome:
    """A Prescription sent again promises a little more time."""
    outcome = RULES["expire resend"][1].then(me, st, i)
    (m,) = outcome.messages
    if not isinstance(m, Prescription):
        return outcome
    return outcome._replace(messages=(m.model_copy(update={"lease_ms": m.lease_ms + 1}),))


def closed_anyhow(me: Me, st: State, i: Any) -> Outcome:
    outcome = always_closed(me, st, i)
    return outcome._replace(state=st)


@contextmanager
def plain(rules: Rules) -> Iterator[Rules]:
    yield rules


@contextmanager
def unarmed(name: str) -> Iterator[Rules]:
    """A timer that is never armed."""

    def some(me: int, st: State) -> list[Timer]:
        return [timer for timer in armed(me, st) if timer.name != name]

    with mock.patch.object(station, "armed", some):
        yield RULES


@contextmanager
def marking(marks: Any) -> Iterator[Rules]:
    with mock.patch.object(State, "marks", property(marks)):
        yield RULES


@dataclass(frozen=True, slots=True)
class Bug:
    """``what`` must break; the exchange found with ``seed`` and shortened has ``steps`` steps."""

    what: str
    change: Callable[[], Any]
    steps: int
    seed: int


def _rows(kind: str, n: int, **row: Any) -> Callable[[], Any]:
    return lambda: plain(changed(kind, n, **row))


BUGS: dict[str, Bug] = {
    "no busy refusal: the last instruction counts": Bug(
        "S-1", _rows("receive Prescription", 2, then=take_over), 3, seed=4
    ),
    "a commitment ends with the sending of its Acceptance": Bug(
        "S-2", _rows("expire giveup", 2, then=give_up_and_leave), 1, seed=3
    ),
    "a refusal counts as agreement": Bug(
        "S-3", _rows("receive Acceptance", 6, when=lambda me, st, i: True), 1, seed=1
    ),
    "everybody recorded is instructed": Bug(
        "S-4", _rows("command prescribe", 2, then=instruct_all), 1, seed=2
    ),
    "the prescriber's lease counts from the Acceptance": Bug(
        "S-5", _rows("receive Acceptance", 6, then=lease_anew), 1, seed=1
    ),
    "anybody's Ack counts": Bug("S-6", lambda: plain(ack_misread(acked_by_anybody)), 3, seed=4),
    "any session of the prescriber is the own one": Bug(
        "S-7", lambda: plain(without("END-4")), 2, seed=1
    ),
    "a receiver that aborts is free at once": Bug(
        "S-8", _rows("command abort", 2, then=free_at_once("command abort", 2)), 3, seed=4
    ),
    "the hold timer is not armed": Bug("T-1", lambda: unarmed("hold"), 2, seed=3),
    "any CAM counts": Bug("T-2", _rows("receive CAM", 0, when=any_cam), 2, seed=1),
    "nothing is given up": Bug("T-3", lambda: unarmed("giveup"), 1, seed=3),
    "the proposal of an Acceptance is not compared": Bug(
        "oracle NEG-6",
        _rows("receive Acceptance", 5, when=lambda me, st, i: not st.awaits_answer),
        2,
        seed=8,
    ),
    "a copy of a Prescription is verified again": Bug(
        "oracle NEG-1",
        _rows("receive Prescription", 4, when=lambda me, st, i: i.message.proposal < st.proposal),
        3,
        seed=1,
    ),
    "no quarantine": Bug("oracle END-8", _rows("receive Advertisement", 3, when=never), 1, seed=2),
    "more stations are recorded than there is room for": Bug(
        "oracle MEM-1", _rows("receive Intention", 5, when=never), 1, seed=1
    ),
    "a session is joined without room for it": Bug(
        "oracle MEM-1", _rows("receive Advertisement", 6, when=never), 2, seed=7
    ),
    "a session is opened without room for it": Bug(
        "oracle MEM-1", _rows("command request", 3, when=never), 1, seed=2
    ),
    "no memory of what was joined": Bug(
        "oracle ADV-8", _rows("receive Advertisement", 4, when=never), 6, seed=2
    ),
    "the mark goes before the Fin is acknowledged": Bug(
        "oracle ACT-5", lambda: marking(bound_session), 3, seed=1
    ),
    "closed is answered although a Fin is still being sent": Bug(
        "oracle NEG-6", _rows("receive Acceptance", 2, then=closed_anyhow), 3, seed=2
    ),
    "a Prescription sent again differs": Bug(
        "oracle REL-1", _rows("expire resend", 1, then=other_content), 1, seed=1
    ),
}


def hunt(bug: Bug, seed: int) -> tuple[str, list[Call]]:
    """The violated property ("" for none), and the shortest exchange that violates it."""
    checks = frozenset({bug.what}) if bug.what in PROPERTIES else ALL
    with bug.change() as rules:
        machine = type("Seeded", (Coordination,), {"rules_": rules, "checks": checks})
        try:
            run(machine, profile(200, 40), seed)
        except Broken as error:
            return error.what, shortened(machine, machine.last, error.what)
    return "", []


if __name__ == "__main__":  # to renew the table: a seed that is quick and ends short
    for name, bug in BUGS.items():
        found = [
            (len(calls) - 1, seed, what)
            for seed in range(1, 10)
            for what, calls in [hunt(bug, seed)]
            if what
        ]
        print(f"{name}: {bug.what}: steps, seed, what broke: {sorted(found)}", flush=True)
