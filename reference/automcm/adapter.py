"""The reference behind the kit, in-process: spec state → reference state → spec state.

The kit's values are those of the oracle (plain JSON lists; docs/oracle.md).  This module is the
map between them and a ``Station``, written down once: ``concrete`` and ``abstract`` are inverse
on every state, so nothing can hide between them.  ``abstract``, ``abstract_input`` and ``answer``
take any ids and limits: the stateful tests give the same inputs to the compiled station.

What the specification leaves out is chosen here (content, the counter behind seq, generation
times) and checked here: a copy must be the very message sent before, new content must take a new
seq.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from types import MappingProxyType
from typing import Any

from automcm.interface import COMMAND, Indication
from automcm.messages import (
    Acceptance,
    Ack,
    Advertisement,
    Cam,
    Cancel,
    Fin,
    Intention,
    Message,
    MessageId,
    Prescription,
    Reliable,
    Trajectory,
)
from automcm.outcome import Expiry, Heard, Input, Me, Restart, Row, Rules
from automcm.rules import RULES
from automcm.state import EntryKey, State, Timer, armed, key
from automcm.station import Effects, Station
from automcm_spec.parameters import Parameters

Json = Any

ME = 1
NOW, LATER = 1_000, 1_000_000
HEARD_MS = 500
LAST_SEQ = 60
ODD_SEQ = 77
PLANNED = Trajectory(t0=0, points=((0, 0, 0), (1000, 8333, 0)))
PRESCRIBED = Trajectory(t0=0, points=((0, 0, 0), (1000, 2778, 0)))
LEASE_MS, HOLD_MS = 60_000, 2_000


def _seq(type_: str, to: int, k: int) -> int:
    """A concrete seq, unique in its session, for a message the specification numbers k."""
    first = {"Advertisement": 0, "Intention": 0, "Prescription": 10, "Acceptance": 20}
    return first[type_] + k if type_ in first else {"Fin": 30, "Cancel": 40}[type_] + to


def _message(value: Json, seq: int) -> Message:
    """A message of the specification with content; ``seq`` replaces its seq."""
    type_, src, dst, session, _, proposal, accepted, reason, of = value
    common: dict[str, Any] = {"src": src, "session": tuple(session), "seq": seq}
    if dst:
        common["dst"] = dst
    match type_:
        case "Advertisement":
            return Advertisement(**common, scenario="lane_change", details={"lane": 2})
        case "Intention":
            return Intention(**common, planned=PLANNED)
        case "Prescription":
            return Prescription(
                **common,
                proposal=proposal,
                prescribed=PRESCRIBED,
                hold_ms=HOLD_MS,
                lease_ms=LEASE_MS,
            )
        case "Acceptance" if accepted:
            return Acceptance(**common, proposal=proposal, accepted=True, selected=PRESCRIBED)
        case "Acceptance":
            why: Any = ("undecided", "unsafe")[proposal % 2] if reason == "as_sent" else reason
            return Acceptance(**common, proposal=proposal, accepted=False, reason=why)
        case "Fin":
            return Fin(**common)
        case "Cancel":
            return Cancel(**common, reason="abort" if reason == "as_sent" else reason)
    return Ack(**{**common, "seq": 0}, of=MessageId(type=of[0], seq=of[1]))


def _entry(value: Json) -> Reliable:
    """An outbox entry of the specification as the message it stands for."""
    type_, to, session, k, accepted = value
    proposal = k if type_ in ("Prescription", "Acceptance") else 0
    described = [type_, ME, to, session, k, proposal, accepted, "as_sent", None]
    message = _message(described, _seq(type_, to, k))
    assert not isinstance(message, Advertisement | Ack)
    return message


def _number(message: Message) -> int:
    """The seq of the specification: the proposal, 1, or 0 for an answer."""
    if message.seq == 0:
        return 0
    return message.proposal if isinstance(message, Prescription | Acceptance) else 1


def abstract_entry(message: Reliable) -> Json:
    """The specification's outbox entry for a message."""
    accepted = isinstance(message, Acceptance) and message.accepted
    return [message.type, message.dst, list(message.session), _number(message), accepted]


def concrete(value: Json) -> State:
    """The reference state for a state of the specification."""
    (phase, role, session, recorded, withdrawn, target, proposal, deciding) = value[:8]
    (heard, number, joined, outbox, quarantine, backoff) = value[8:]
    bound = phase != "STANDALONE"
    key_ = tuple(session) if bound else None
    advertisement = None
    if phase == "ADVERTISING":
        described = ["Advertisement", ME, 0, session, 1, 0, False, "none", None]
        message = _message(described, 1)
        assert isinstance(message, Advertisement)
        advertisement = message
    intentions = {}
    for p in recorded:
        message = _message(["Intention", p, ME, session, 1, 0, False, "none", None], 1)
        assert isinstance(message, Intention)
        intentions[p] = message
    return State(
        phase=phase,
        role=role,
        session=key_,
        advertisement=advertisement,
        recorded=MappingProxyType(intentions),
        withdrawn=frozenset(withdrawn),
        target=target,
        proposal=proposal,
        deciding=deciding,
        heard_ms=HEARD_MS if heard else None,
        number=number,
        joined=MappingProxyType({p: n for p, n in joined}),
        outbox=tuple(_entry(entry) for entry in outbox),
        quarantine=quarantine,
        backoff=backoff,
        lease_ms=LEASE_MS if proposal else 0,
        seq=LAST_SEQ if bound else 0,
    )


def abstract(st: State) -> Json:
    """The specification's state for a reference state."""
    return [
        st.phase,
        st.role,
        list(st.session or (0, 0)),
        _sorted(st.recorded),
        _sorted(st.withdrawn),
        st.target,
        st.proposal,
        st.deciding,
        st.heard_ms is not None,
        st.number,
        _sorted([p, n] for p, n in st.joined.items()),
        _sorted(abstract_entry(message) for message in st.outbox),
        st.quarantine,
        st.backoff,
    ]


def _sorted(values: Iterable[Json]) -> list[Json]:
    """A set as the oracle writes it: sorted by JSON text."""
    listed = list(values)
    if len(listed) > 1:
        listed.sort(key=lambda value: json.dumps(value, separators=(",", ":")))
    return listed


# -- what a station takes and does, in the specification's form


def abstract_input(st: State, i: Input) -> Json:
    """The specification's input for an input of the reference in this state."""
    match i:
        case Heard(message, planned):
            return ["receive", _heard(st, message), planned is not None]
        case Cam():
            newer = st.heard_ms is None or i.generation_ms > st.heard_ms
            return ["cam", i.src, _sorted(list(session) for session in set(i.marks)), newer]
        case Expiry(timer):
            return ["expire", _abstract_timer(timer, st)]
        case Restart():
            return ["restart"]
    session = list(getattr(i, "session", (0, 0)))
    return ["command", i.name, session, getattr(i, "proposal", 0), getattr(i, "target", 0)]


def _heard(st: State, m: Message) -> Json:
    """A message received.  An Ack names an entry of the outbox, or by -seq what is not there."""
    described = _described(m)
    if m.seq and described[7] != "none":
        described[7] = "as_sent"
    if isinstance(m, Ack):
        named = EntryKey(m.of.type, m.src, m.session, m.of.seq)
        entry = next((e for e in st.outbox if key(e) == named), None)
        described[8] = [m.of.type, _number(entry) if entry else -m.of.seq]
    return described


def _described(m: Message) -> Json:
    """A message of the specification, but for what an Ack names."""
    accepted = isinstance(m, Acceptance) and m.accepted
    reason = getattr(m, "reason", None) or "none"
    proposal = m.proposal if isinstance(m, Prescription | Acceptance) else 0
    start = [m.type, m.src, m.dst, list(m.session), _number(m)]
    return [*start, proposal, accepted, reason, ["none", 0]]


def answer(before: State, given: Message | None, effects: Effects) -> tuple[Json, Json, Json, Json]:
    """Messages, indication, timers armed and timers stopped; ``given`` is the message received."""
    messages = _sorted(_sent(before, given, m) for m in effects.messages)
    told = ["nothing"]
    for indication in effects.indications:
        told = _told(indication, given)
    arm = _sorted(_abstract_timer(t, effects.state) for t, _ in effects.armed)
    stop = _sorted(_abstract_timer(t, before) for t in effects.stopped)
    return messages, told, arm, stop


def is_copy(before: State, m: Message) -> bool:
    """Is it the very message that is being sent reliably, or broadcast, already?"""
    return m in before.outbox or m == before.advertisement


def _sent(before: State, given: Message | None, m: Message) -> Json:
    described, copy = _described(m), is_copy(before, m)
    if isinstance(m, Ack):
        named = given is not None and m.of == MessageId(type=given.type, seq=given.seq)
        described[8] = [m.of.type, (_number(given) if given and named else "wrong")]
    if m.seq and not copy and m.seq <= before.seq and not isinstance(m, Intention):
        described[4] = "wrong"  # new content takes a new seq
    if copy and described[7] != "none":
        described[7] = "as_sent"
    return described


def _told(indication: Indication, given: Message | None) -> Json:
    if indication.name != "fallback":
        return [indication.name]
    reason = indication.reason
    if isinstance(given, Cancel) and given.seq and reason == given.reason:
        reason = "as_sent"
    return ["fallback", reason]


def _abstract_timer(timer: Timer, st: State) -> Json:
    if timer.name == "forget":
        return ["forget", timer.station]
    if timer.entry is None:
        return [timer.name]
    if timer.entry.type == "Advertisement":
        return [timer.name, ["Advertisement", 0, list(timer.entry.session), 1, False]]
    return [timer.name, _entry_of(st, timer.entry)]


def _entry_of(st: State, wanted: EntryKey) -> Json:
    for message in st.outbox:
        if key(message) == wanted:
            return abstract_entry(message)
    return ["unknown", *wanted]


class Reference:
    """A station that the kit puts into a state, gives an input and reads the answer of."""

    def __init__(self, constants: dict[str, Json], rules: Rules = RULES) -> None:
        self._parameters = Parameters(
            max_rounds=constants["MaxRounds"],
            max_participants=constants["MaxParticipants"],
            outbox_limit=constants["OutboxLimit"],
            memory_limit=constants["MemoryLimit"],
        )
        self._rules = rules
        self._messages: dict[int, tuple[Json, Message]] = {}
        self._base: State | None = None
        self._value: Json = None
        self._armed: dict[Timer, int] = {}
        self.station = self._fresh()

    def _fresh(self) -> Station:
        return Station(ME, self._parameters, plan=lambda _: self._plan, rules=self._rules)

    _plan: Trajectory | None = None

    def reset(self) -> None:
        """Back to the initial state."""
        self.station = self._fresh()

    def put(self, state: Json) -> None:
        """Into this state of the specification, with its timers running."""
        self.put_state(concrete(state))

    def put_state(self, state: State) -> None:
        """Into this reference state (one that was reached before)."""
        if state is not self._base:
            self._base = state
            self._value = abstract(state)
            self._armed = dict.fromkeys(armed(ME, state), LATER)
        self.station.state = state
        self.station.timers = self._armed.copy()
        self.station._now = 0

    def save(self) -> State:
        """What it is in now, for ``put_state``."""
        return self.station.state

    def state(self) -> Json:
        """The specification's state it is in."""
        state = self.station.state
        return self._value if state is self._base else abstract(state)

    def marks(self) -> Json:
        """The sessions its CAM would name."""
        return [list(session) for session in self.station.state.marks]

    def apply(self, value: Json) -> tuple[Json, Json, Json, Json]:
        """One input.  Returns messages, told, timers armed and timers stopped."""
        before = self.station.state
        given, (only,) = self.give(value)
        return answer(before, given, only)

    def give(self, value: Json) -> tuple[Message | None, list[Effects]]:
        """One input, as the station takes it: the message if it is one, and what it does."""
        station = self.station
        match value[0]:
            case "receive":
                given = self._concrete_message(value[1])
                self._plan = PLANNED if value[2] else None
                return given, station.receive(given, NOW)
            case "cam":
                return None, station.receive(self._cam(value), NOW)
            case "command":
                return None, station.command(self._command(value), NOW)
            case "expire":
                station.timers[self._timer(value[1])] = NOW
                return None, station.advance(NOW)
        return None, station.restart(NOW)

    # -- inputs

    def _concrete_message(self, value: Json) -> Message:
        type_, src, k = value[0], value[1], value[4]
        if type_ != "Ack":
            if id(value) not in self._messages:  # kept, so that its id stays its own
                self._messages[id(value)] = value, _message(value, 100 + k if k else 0)
            return self._messages[id(value)][1]
        of_type, of_k = value[8]
        of_seq = 0 if of_k == 0 else self._acked_seq(src, tuple(value[3]), of_type, of_k)
        return _message([*value[:8], [of_type, of_seq]], 0)

    def _acked_seq(self, src: int, session: Any, type_: str, k: int) -> int:
        """The seq of the entry named, or, to try the check, of another entry to the same one."""
        others = [m for m in self.station.state.outbox if m.dst == src and m.session == session]
        for m in others:
            if (m.type, _number(m)) == (type_, k):
                return m.seq
        return next((m.seq for m in others if m.type != type_), ODD_SEQ)

    def _cam(self, value: Json) -> Cam:
        _, src, marks, newer = value
        last = self.station.state.heard_ms or HEARD_MS
        return Cam(
            src=src,
            generation_ms=last + 100 if newer else last,
            x_mm=0,
            y_mm=0,
            heading_mrad=0,
            speed_mm_s=8333,
            marks=tuple(tuple(session) for session in marks),
        )

    def _command(self, value: Json) -> Any:
        _, name, session, proposal, target = value
        fields: dict[str, Any] = {"name": name}
        if name == "request":
            fields |= {"scenario": "lane_change"}
        else:
            fields |= {"session": tuple(session)}
        if name in ("prescribe", "accept", "refuse"):
            fields |= {"proposal": proposal}
        if name == "prescribe":
            fields |= {"target": target, "prescribed": PRESCRIBED}
            fields |= {"hold_ms": HOLD_MS, "lease_ms": LEASE_MS}
        if name == "accept":
            fields |= {"selected": PRESCRIBED}
        return COMMAND.validate_python(fields)

    def _timer(self, value: Json) -> Timer:
        """The armed timer that the specification names so."""
        for timer in self.station.timers:
            if _abstract_timer(timer, self.station.state) == value:
                return timer
        raise LookupError(f"not armed: {value}")


def without(rule: str) -> Rules:
    """The rules with one taken away: its rows go, and what stands below them decides.

    END-4 is no row but the guard of many: without it any session of the same prescriber counts.
    """
    if rule == "END-4":
        return {kind: tuple(map(_loose, rows)) for kind, rows in RULES.items()}
    return {kind: tuple(row for row in rows if row.rule != rule) for kind, rows in RULES.items()}


def _loose(row: Row) -> Row:
    """The row; to its guard the session of a message is the own one if the prescriber is."""

    def when(me: Me, st: State, i: Input) -> bool:
        if isinstance(i, Heard) and st.session and st.session[0] == i.message.session[0]:
            st = st._replace(session=i.message.session)
        return row.when(me, st, i)

    return row._replace(when=when)
