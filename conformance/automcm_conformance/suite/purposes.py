"""Test purposes: the subject of each case, in words, and its pairs of the graph.

``conformance/suite/purposes.toml`` holds them.  A purpose with ``select`` owns the pairs of state
and input that its selector matches; the first match in the order of the file wins.  A purpose with
``case`` is about what no graph of one station says (durations, bytes, several stations); the kit
implements it by that name.  An id says role, group of rules, and kind: BV, valid behaviour; BI,
invalid or inopportune; TI, timers.

Fields of a selector; all are optional, and all that are given must match:

========  =========================================================================
rule      the rule that decides
role      of the state: none, prescriber, receiver
phase     of the state
input     see ``input_kind``
changes   a transition (true), or a refusal (false)
own       the message or command names the session that the station is bound to
accepted  of a received Acceptance
answer    the message received has seq 0
reason    of a received Acceptance or Cancel; ``as_sent`` is any that no answer has
of        the type that a received Ack names
deciding  the prescriber computes its next proposal
told      what the application is told, such as ``nothing`` or ``fallback``
sends     what is sent: ``nothing``, or types such as ``Ack + Cancel``; an answer that gives a
          reason with it, such as ``Cancel(closed)``
why       what is wrong with the input, or special about it: see ``WHY``
third     a third station takes part: the pair is one of suite/two_peer_pairs.py
========  =========================================================================
"""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator

from automcm_conformance.adapter.kit_paths import SUITE
from automcm_conformance.adapter.protocol import ROOM
from automcm_conformance.exchange.results import LEVELS, Level
from automcm_spec.graph.oracle import Effect
from automcm_spec.vocabulary import station as spec
from automcm_spec.vocabulary.rules import RULES, kind

Features = tuple[Any, ...]
Wanted = Annotated[frozenset[Any], BeforeValidator(lambda v: v if isinstance(v, list) else [v])]
"""In the file, one value is a list of one."""
PATH = SUITE / "purposes.toml"

FEATURES = (
    *("rule", "role", "phase", "input", "changes", "own", "accepted", "answer", "reason"),
    *("of", "deciding", "told", "sends", "why", "third"),
)


class Purpose(BaseModel, frozen=True, extra="forbid"):
    """One test purpose. ``rules[0]`` decides; it has either ``select`` or ``case``."""

    id: str
    rules: tuple[str, ...]
    level: Level
    given: str
    when: str
    then: str
    bug: str
    cost: str
    select: dict[str, Wanted] | None = None
    """The matching values of each field."""
    case: str = ""
    """The name of a case that no pair of the graph carries; empty with ``select``."""

    def matches(self, features: Features) -> bool:
        """Whether a pair with these features (in the order of ``FEATURES``) belongs to this
        case."""
        return self.select is not None and all(
            features[FEATURES.index(name)] in values for name, values in self.select.items()
        )


@cache
def load(path: Path = PATH) -> tuple[Purpose, ...]:
    """The purposes of a file, which is read once."""
    rows = tomllib.loads(path.read_text(encoding="utf-8"))["purpose"]
    return tuple(map(Purpose.model_validate, rows))


def input_kind(i: spec.Input) -> str:
    """The kind of an input, such as ``receive Ack``, ``cam``, ``command close``, ``expire hold`` or
    ``restart``. The timers of a message carry its type: ``expire resend Fin``."""
    match i:
        case spec.Expire(timer=(_, spec.Entry() as entry)):
            return f"{kind(i)} {entry.type}"
        case spec.Cam():
            return i.kind
    return kind(i)


def features(
    state: spec.State, i: spec.Input, effect: Effect, changes: bool, third: bool
) -> Features:
    """The values that selectors examine, in the order of ``FEATURES``; None if there is none."""
    own = accepted = answer = reason = of = why = None
    if isinstance(i, spec.Receive):
        message = i.message
        own = state.session == message.session
        answer = message.seq == 0
        if message.type == "Ack":
            of = message.of[0]
        elif message.type in ("Acceptance", "Cancel"):
            accepted, reason = message.accepted, message.reason
    elif isinstance(i, spec.Command):
        own = state.session == i.session
    if effect.rule in WHY:
        why = WHY[effect.rule](state, i, changes)
    sends = _sent(effect.messages) if effect.messages else "nothing"
    return (
        *(effect.rule, state.role, state.phase, input_kind(i), changes, own, accepted, answer),
        *(reason, of, state.deciding, effect.indication[0], sends, why, third),
    )


def _sent(messages: Sequence[spec.Message]) -> str:
    """The types sent; an answer with a reason is given with it."""
    names = [
        f"{m.type}({m.reason})" if m.seq == 0 and m.reason != "none" else m.type for m in messages
    ]
    return names[0] if len(names) == 1 else " + ".join(sorted(names))


def _fault(state: spec.State, i: spec.Input, changes: bool) -> str:
    """END-5: the first error of the message."""
    assert isinstance(i, spec.Receive)
    m = i.message
    if m.src == 1:
        return "echo"
    if (m.dst == 0) != (m.type == "Advertisement"):
        return "broadcast" if m.dst == 0 else "addressed"
    if m.type in ("Advertisement", "Prescription") and m.src != m.session[0]:
        return "not its prescriber"
    if m.type in ("Intention", "Acceptance") and m.session[0] != 1:
        return "not my session"
    if m.type == "Cancel" and m.reason == "closed":
        return "closed"
    if m.type == "Prescription":
        taken = state.session == m.session and state.phase in ("NEGOTIATING", "ACTUATING")
        return "out of turn" if taken else "last round"
    return "not the target" if m.src != state.target else "not sent yet"


def _ack(state: spec.State, i: spec.Input, changes: bool) -> str | None:
    """END-6: the mismatch of an Ack with the outbox entry it comes closest to."""
    if changes:
        return None
    assert isinstance(i, spec.Receive)
    m = i.message
    if m.of[1] == 0:
        return "seq 0"
    best = 0
    for entry in state.outbox:
        named = (entry.type, entry.seq) == m.of
        same_session = entry.session == m.session
        if entry.to != m.src:
            if same_session and named:
                return "sender"
        elif not same_session:
            if named:
                best = 3
        else:
            best = max(best, 2 if entry.type == m.of[0] else 1)
    return ("nothing waits", "type", "seq", "session")[best]


def _cam(state: spec.State, i: spec.Input, changes: bool) -> str | None:
    """ACT-5: why a CAM does not count."""
    if not isinstance(i, spec.Cam) or changes:
        return None
    if state.phase != "ACTUATING":
        return "phase"
    if i.src != (state.session[0] if state.role == "receiver" else state.target):
        return "sender"
    if state.session in i.marks:
        return "older"
    return "other mark" if i.marks else "no mark"


def _stale(state: spec.State, i: spec.Input, changes: bool) -> str | None:
    """PRE-5: the wrong part of the command."""
    if not isinstance(i, spec.Command):
        return None
    return "session" if i.session != state.session else "proposal"


def _joined(state: spec.State, i: spec.Input, changes: bool) -> str | None:
    """ADV-8: an Advertisement of the newest session joined, or of an older one."""
    if not isinstance(i, spec.Receive):
        return None
    return "copy" if i.message.session in state.joined else "older"


def _proposal(state: spec.State, i: spec.Input, changes: bool) -> str | None:
    """NEG-1: a copy of the newest Prescription, or an older one."""
    if changes:
        return None
    assert isinstance(i, spec.Receive)
    return "copy" if i.message.proposal == state.proposal else "older"


def _withdraws(state: spec.State, i: spec.Input, changes: bool) -> str | None:
    """END-2: a Cancel in ADVERTISING from a station that is recorded, or not."""
    if state.phase != "ADVERTISING":
        return None
    assert isinstance(i, spec.Receive)
    return "recorded" if i.message.src in state.recorded else "not recorded"


def _full(state: spec.State, i: spec.Input, changes: bool) -> str:
    """MEM-1: the list that is full."""
    if isinstance(i, spec.Receive) and i.message.type == "Intention":
        return "participants"
    return "outbox" if len(state.outbox) > ROOM else "memory"


WHY: dict[str, Callable[[spec.State, spec.Input, bool], str | None]] = {
    "END-5": _fault,
    "END-6": _ack,
    "ACT-5": _cam,
    "PRE-5": _stale,
    "ADV-8": _joined,
    "NEG-1": _proposal,
    "END-2": _withdraws,
    "MEM-1": _full,
}
"""By rule. For END-6 and ACT-5: why an Ack or a CAM does not count."""


class Owners:
    """The purpose of each pair of state and input."""

    def __init__(self, purposes: Iterable[Purpose]) -> None:
        self.purposes = [purpose for purpose in purposes if purpose.select is not None]
        self._seen: dict[Features, Purpose | None] = {}

    def owner(
        self, state: spec.State, i: spec.Input, effect: Effect, changes: bool, third: bool = False
    ) -> Purpose | None:
        """The first purpose whose selector matches; None if there is none."""
        key = features(state, i, effect, changes, third)
        try:
            return self._seen[key]
        except KeyError:
            found = next((p for p in self.purposes if p.matches(key)), None)
            self._seen[key] = found
            return found


def select(purposes: Iterable[Purpose], selectors: Iterable[str]) -> list[Purpose]:
    """The purposes that one of the selectors names; all without a selector.

    A selector is an id or its beginning (``AMCM/RCV``), a rule (``NEG-4``), a level (``MUST``), or
    the first word of the name of cases that no graph carries (``quantity``).
    Raises ValueError for a selector that names nothing, with similar ones.
    """
    everything, wanted = list(purposes), [each.strip().rstrip("/").upper() for each in selectors]
    if not wanted:
        return everything
    for each in wanted:
        if not any(_names(each, purpose) for purpose in everything):
            known = {*RULES, *LEVELS, *(p.id for p in everything)}
            known |= {p.id[:end] for p in everything for end in (4, 8, 12, 15)}
            near = difflib.get_close_matches(each, sorted(known), 3)
            hint = f"; near ones: {', '.join(near)}" if near else ""
            raise ValueError(f"{each}: no case has this id, rule, level or name{hint}")
    return [p for p in everything if any(_names(each, p) for each in wanted)]


def _names(selector: str, purpose: Purpose) -> bool:
    word = purpose.case.partition(" ")[0].upper()
    return selector in (purpose.id, purpose.level, *purpose.rules, word or purpose.id) or (
        purpose.id.startswith((selector + "/", selector + "-"))
    )
