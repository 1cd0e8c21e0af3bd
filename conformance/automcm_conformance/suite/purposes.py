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
import re
import tomllib
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Self, get_args

from pydantic import (
    BaseModel,
    Field,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from automcm_conformance.adapter.kit_paths import SUITE
from automcm_conformance.adapter.protocol import INDICATIONS, MESSAGE_TYPES
from automcm_conformance.exchange.results import Level
from automcm_spec.graph.oracle import Effect
from automcm_spec.support.bad_input import errors_of
from automcm_spec.vocabulary import application
from automcm_spec.vocabulary.application import Phase, Role, names
from automcm_spec.vocabulary.messages import ANSWER_REASONS, RELIABLE
from automcm_spec.vocabulary.parameters import TIMERS
from automcm_spec.vocabulary.rules import RULES, kind
from automcm_spec.vocabulary.station import (
    Cam,
    Command,
    Entry,
    Expire,
    Input,
    Message,
    Receive,
    State,
)

Features = tuple[Any, ...]

PATH = SUITE / "purposes.toml"

LEVELS: tuple[Level, ...] = get_args(Level)
ID = r"AMCM/(PRE|RCV|STA|SYS)/(ADV|PRE|NEG|ACT|END|REL|CMD|MSG|MEM)/(BV|BI|TI)-(0[1-9]|[1-9]\d)"

INPUTS = (
    *(f"receive {name}" for name in MESSAGE_TYPES),
    "cam",
    *(f"command {name}" for name in names(application.Command)),
    *(f"expire {name}" for name in TIMERS if name not in ("giveup", "resend")),
    *(f"expire resend {name}" for name in MESSAGE_TYPES[:-1]),
    *(f"expire giveup {name}" for name in RELIABLE),
    "restart",
)
WHY = {
    "END-5": (
        "echo",  # from the station's own id
        "addressed",  # an Advertisement
        "broadcast",  # of another type
        "not its prescriber",  # who sends an Advertisement or a Prescription
        "not my session",  # in an Intention or an Acceptance
        "closed",  # from anybody but the prescriber
        "not the target",
        "not sent yet",  # the proposal that is accepted or refused
        "out of turn",  # a newer proposal
        "last round",  # a proposal above max_rounds that would not be out of turn
    ),
    "END-6": ("seq 0", "sender", "session", "seq", "type", "nothing waits"),
    "ACT-5": ("phase", "sender", "no mark", "other mark", "older"),
    "PRE-5": ("session", "proposal"),
    "ADV-8": ("copy", "older"),
    "NEG-1": ("copy", "older"),
    "END-2": ("recorded", "not recorded"),
    "MEM-1": ("outbox", "memory", "participants"),
}
"""Values of ``why``, by rule. For END-6 and ACT-5: why an Ack or a CAM does not count."""
ROOM = 1
"""In every graph a session needs at most this many outbox entries (MEM-1)."""

_NAMES: dict[str, Iterable[str]] = {
    "rule": RULES,
    "role": get_args(Role),
    "phase": get_args(Phase),
    "input": INPUTS,
    "reason": ("none", "as_sent", *ANSWER_REASONS),
    "of": MESSAGE_TYPES,
    "told": ("nothing", *INDICATIONS),
    "why": {name for names in WHY.values() for name in names},
}
"""Fields that take a name or a list of names, with the allowed names."""
_FLAGS = ("changes", "own", "accepted", "answer", "deciding", "third")
_SENDS = re.compile(r"nothing|[A-Z][a-z]+(\([a-z_]+\))?( \+ [A-Z][a-z]+(\([a-z_]+\))?)*")
FEATURES = (
    *("rule", "role", "phase", "input", "changes", "own", "accepted", "answer", "reason"),
    *("of", "deciding", "told", "sends", "why", "third"),
)


_Text = Annotated[str, Field(pattern=r"\S")]


class Purpose(BaseModel, frozen=True, strict=True, extra="forbid"):
    """One test purpose. ``rules[0]`` decides; it has either ``select`` or ``case``."""

    id: Annotated[str, Field(pattern=f"^{ID}$")]
    rules: tuple[str, ...] = Field(min_length=1, strict=False)
    level: Level
    given: _Text
    when: _Text
    then: _Text
    bug: _Text
    cost: _Text
    select: dict[str, frozenset[Any]] | None = None
    """The matching values of each field."""
    case: str = ""
    """The name of a case that no pair of the graph carries; empty with ``select``."""

    @field_validator("rules")
    @classmethod
    def _known_rules(cls, rules: tuple[str, ...], about: ValidationInfo) -> tuple[str, ...]:
        for rule in rules:
            if rule not in RULES:
                raise ValueError(f"unknown rule {rule}")
        group = about.data.get("id", "").split("/")[2:3]
        if group and not rules[0].startswith(group[0]):
            raise ValueError(f"the first must be of the group {group[0]}")
        return rules

    @field_validator("select", mode="before")
    @classmethod
    def _known_values(cls, fields: object) -> dict[str, frozenset[Any]]:
        if not isinstance(fields, dict) or not fields:
            raise ValueError("must be a table with at least one field")
        found = {
            name: frozenset(wanted if isinstance(wanted, list) else [wanted])
            for name, wanted in fields.items()
        }
        for name, values in found.items():
            if name not in FEATURES:
                raise ValueError(f"{name}: unknown field")
            if not values:
                raise ValueError(f"{name}: must not be empty")
            for value in values:
                if not _known(name, value):
                    raise ValueError(f"{name}: unknown value {value}")
        if "rule" not in found:
            raise ValueError("rule: is required")
        return found

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.select is None) == (not self.case.strip()):
            raise ValueError("give either select or case")
        return self

    @property
    def kind(self) -> str:
        """BV, BI or TI."""
        return self.id.split("/")[3][:2]

    def matches(self, features: Features) -> bool:
        """Whether a pair with these features (in the order of ``FEATURES``) belongs to this
        case."""
        return self.select is not None and all(
            features[FEATURES.index(name)] in values for name, values in self.select.items()
        )


@cache
def load(path: Path = PATH) -> tuple[Purpose, ...]:
    """The purposes of a file, which is read once. Raises ValueError with file, id and field."""
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path.name}: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{path.name}: not TOML: {error}") from None
    rows = data.get("purpose")
    if set(data) != {"purpose"} or not isinstance(rows, list):
        raise ValueError(f"{path.name}: must contain a list of [[purpose]] and nothing else")
    found: dict[str, Purpose] = {}
    for number, row in enumerate(rows, 1):
        name = row.get("id", f"purpose {number}") if isinstance(row, dict) else f"purpose {number}"
        try:
            purpose = Purpose.model_validate(row)
        except ValidationError as error:
            problem = ": ".join(filter(None, errors_of(error)[0]))
            raise ValueError(f"{path.name}: {name}: {problem}") from None
        if purpose.id in found:
            raise ValueError(f"{path.name}: {name}: id: used twice")
        if purpose.case and any(purpose.case == other.case for other in found.values()):
            raise ValueError(f"{path.name}: {name}: case: used twice")
        found[purpose.id] = purpose
    return tuple(found.values())


def _known(name: str, value: object) -> bool:
    if name in _FLAGS:
        return isinstance(value, bool)
    if name == "sends":
        return isinstance(value, str) and _SENDS.fullmatch(value) is not None
    return isinstance(value, str) and value in _NAMES[name]


def input_kind(i: Input) -> str:
    """The kind of an input: one of ``INPUTS``. The timers of a message carry its type."""
    match i:
        case Expire(timer=(_, Entry() as entry)):
            return f"{kind(i)} {entry.type}"
        case Cam():
            return i.kind
    return kind(i)


def features(state: State, i: Input, effect: Effect, changes: bool, third: bool) -> Features:
    """The values that selectors examine, in the order of ``FEATURES``; None if there is none."""
    own = accepted = answer = reason = of = why = None
    if isinstance(i, Receive):
        message = i.message
        own = state.session == message.session
        answer = message.seq == 0
        if message.type == "Ack":
            of = message.of[0]
        elif message.type in ("Acceptance", "Cancel"):
            accepted, reason = message.accepted, message.reason
    elif isinstance(i, Command):
        own = state.session == i.session
    if effect.rule in _WHY:
        why = _WHY[effect.rule](state, i, changes)
    sends = _sent(effect.messages) if effect.messages else "nothing"
    return (
        *(effect.rule, state.role, state.phase, input_kind(i), changes, own, accepted, answer),
        *(reason, of, state.deciding, effect.indication[0], sends, why, third),
    )


def _sent(messages: Sequence[Message]) -> str:
    """The types sent; an answer with a reason is given with it."""
    names = [
        f"{m.type}({m.reason})" if m.seq == 0 and m.reason != "none" else m.type for m in messages
    ]
    return names[0] if len(names) == 1 else " + ".join(sorted(names))


def _fault(state: State, i: Input, changes: bool) -> str:
    """END-5: the first error of the message."""
    assert isinstance(i, Receive)
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


def _ack(state: State, i: Input, changes: bool) -> str | None:
    """END-6: the mismatch of an Ack with the outbox entry it comes closest to."""
    if changes:
        return None
    assert isinstance(i, Receive)
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


def _cam(state: State, i: Input, changes: bool) -> str | None:
    """ACT-5: why a CAM does not count."""
    if not isinstance(i, Cam) or changes:
        return None
    if state.phase != "ACTUATING":
        return "phase"
    if i.src != (state.session[0] if state.role == "receiver" else state.target):
        return "sender"
    if state.session in i.marks:
        return "older"
    return "other mark" if i.marks else "no mark"


def _stale(state: State, i: Input, changes: bool) -> str | None:
    """PRE-5: the wrong part of the command."""
    if not isinstance(i, Command):
        return None
    return "session" if i.session != state.session else "proposal"


def _joined(state: State, i: Input, changes: bool) -> str | None:
    """ADV-8: an Advertisement of the newest session joined, or of an older one."""
    if not isinstance(i, Receive):
        return None
    return "copy" if i.message.session in state.joined else "older"


def _proposal(state: State, i: Input, changes: bool) -> str | None:
    """NEG-1: a copy of the newest Prescription, or an older one."""
    if changes:
        return None
    assert isinstance(i, Receive)
    return "copy" if i.message.proposal == state.proposal else "older"


def _withdraws(state: State, i: Input, changes: bool) -> str | None:
    """END-2: a Cancel in ADVERTISING from a station that is recorded, or not."""
    if state.phase != "ADVERTISING":
        return None
    assert isinstance(i, Receive)
    return "recorded" if i.message.src in state.recorded else "not recorded"


def _full(state: State, i: Input, changes: bool) -> str:
    """MEM-1: the list that is full."""
    if isinstance(i, Receive) and i.message.type == "Intention":
        return "participants"
    return "outbox" if len(state.outbox) > ROOM else "memory"


_WHY: dict[str, Callable[[State, Input, bool], str | None]] = {
    "END-5": _fault,
    "END-6": _ack,
    "ACT-5": _cam,
    "PRE-5": _stale,
    "ADV-8": _joined,
    "NEG-1": _proposal,
    "END-2": _withdraws,
    "MEM-1": _full,
}


class Owners:
    """The purpose of each pair of state and input."""

    def __init__(self, purposes: Iterable[Purpose]) -> None:
        self.purposes = [purpose for purpose in purposes if purpose.select is not None]
        self._seen: dict[Features, Purpose | None] = {}

    def owner(
        self, state: State, i: Input, effect: Effect, changes: bool, third: bool = False
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
