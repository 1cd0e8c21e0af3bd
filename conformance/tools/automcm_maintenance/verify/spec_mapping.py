"""The reference behind the kit, in-process: spec state → reference state → spec state.

The kit's values are those of the specification (automcm_spec.vocabulary.station).  This module maps
them to and from a ``Station``.  ``concrete`` and ``abstract`` are inverse on every state, so that
the mapping hides no difference.  ``abstract``, ``abstract_input`` and ``answer`` take any ids and
limits, because the stateful tests give the same inputs to the compiled station.

This module chooses and checks what the specification omits (content, seq, generation times): a copy
must equal the message sent before, and new content must have a new seq.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, TypeVar

from automcm.core.outcome import Expiry, Input, Me, Received, ReceivedCam, Restart, Row, Rules
from automcm.core.rules import RULES
from automcm.core.state import EntryKey, State, Timer, armed, key
from automcm.core.station import Effects, Station
from automcm_spec.vocabulary import station as spec
from automcm_spec.vocabulary.application import COMMAND, Fallback, Indication
from automcm_spec.vocabulary.messages import (
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
from automcm_spec.vocabulary.parameters import Parameters, cam_lead

_Input = TypeVar("_Input")

ME = 1
NOW, LATER = 1_000, 1_000_000
CAM_MS = 500
LAST_SEQ = 60
UNUSED_SEQ = 77
WRONG = -1
"""A seq that no message of the specification has."""
PLANNED = Trajectory(t0=0, points=((0, 0, 0), (1000, 8333, 0)))
PRESCRIBED = Trajectory(t0=0, points=((0, 0, 0), (1000, 2778, 0)))
LEASE_MS = 60_000
PRESCRIBES: Any = {"prescribed": PRESCRIBED, "hold_ms": 2_000, "lease_ms": LEASE_MS}


def _seq(type_: str, to: int, k: int) -> int:
    """A concrete seq, unique in its session, for the message with number k of the specification."""
    first = {"Advertisement": 0, "Intention": 0, "Prescription": 10, "Acceptance": 20}
    return first[type_] + k if type_ in first else {"Fin": 30, "Cancel": 40}[type_] + to


@cache
def _message(value: spec.Message, seq: int) -> Any:
    """A message of the specification with content and with ``seq`` as its seq."""
    type_, src, dst, session, _, proposal, accepted = value[:7]
    reason: Any = value.reason
    of: Any = value.of
    common: dict[str, Any] = {"src": src, "session": session, "seq": seq}
    if dst:
        common["dst"] = dst
    match type_:
        case "Advertisement":
            return Advertisement(**common, scenario="lane_change", details={"lane": 2})
        case "Intention":
            return Intention(**common, planned=PLANNED)
        case "Prescription":
            return Prescription(**common, proposal=proposal, **PRESCRIBES)
        case "Acceptance" if accepted:
            return Acceptance(**common, proposal=proposal, accepted=True, selected=PRESCRIBED)
        case "Acceptance":
            if reason == "as_sent":
                reason = ("undecided", "unsafe")[proposal % 2]
            return Acceptance(**common, proposal=proposal, accepted=False, reason=reason)
        case "Fin":
            return Fin(**common)
        case "Cancel":
            return Cancel(**common, reason="abort" if reason == "as_sent" else reason)
    return Ack(**{**common, "seq": 0}, of=MessageId(type=of[0], seq=of[1]))


def _first(type_: str, src: int, dst: int, session: spec.Session) -> spec.Message:
    """The first message of a station in a session."""
    return spec.Message(type_, src, dst, session, 1, 0, False, "none", ("none", 0))


def _entry(value: spec.Entry) -> Reliable:
    """The message of an outbox entry of the specification."""
    type_, to, session, k, accepted = value
    proposal = k if type_ in ("Prescription", "Acceptance") else 0
    described = spec.Message(type_, ME, to, session, k, proposal, accepted, "as_sent", ("none", 0))
    message: Reliable = _message(described, _seq(type_, to, k))
    return message


def _number(message: Message) -> int:
    """The number in the specification: the proposal, 1, or 0 for an answer."""
    if message.seq == 0:
        return 0
    return message.proposal if isinstance(message, Prescription | Acceptance) else 1


def abstract_entry(message: Reliable) -> spec.Entry:
    """The specification's outbox entry for a message."""
    accepted = isinstance(message, Acceptance) and message.accepted
    return spec.Entry(message.type, message.dst, message.session, _number(message), accepted)


def concrete(value: spec.State) -> State:
    """The reference state for a state of the specification."""
    phase: Any = value.phase
    role: Any = value.role
    bound, session = phase != "STANDALONE", value.session
    advertisement = _first("Advertisement", ME, 0, session)
    recorded = {p: _message(_first("Intention", p, ME, session), 1) for p in sorted(value.recorded)}
    return State(
        phase=phase,
        role=role,
        session=session if bound else None,
        advertisement=_message(advertisement, 1) if phase == "ADVERTISING" else None,
        recorded=MappingProxyType(recorded),
        withdrawn=value.withdrawn,
        target=value.target,
        proposal=value.proposal,
        deciding=value.deciding,
        heard_ms=CAM_MS if value.heard else None,
        first_cam_ms=(CAM_MS, NOW) if value.heard else None,
        number=value.number,
        joined=MappingProxyType(dict(sorted(value.joined))),
        outbox=tuple(map(_entry, sorted(value.outbox))),
        quarantine=value.quarantine,
        backoff=value.backoff,
        lease_ms=LEASE_MS if value.proposal else 0,
        seq=LAST_SEQ if bound else 0,
    )


def abstract(st: State) -> spec.State:
    """The specification's state for a reference state."""
    return spec.State(
        st.phase,
        st.role,
        st.session or (0, 0),
        frozenset(st.recorded),
        frozenset(st.withdrawn),
        st.target,
        st.proposal,
        st.deciding,
        st.heard_ms is not None,
        st.number,
        frozenset(st.joined.items()),
        _set(map(abstract_entry, st.outbox)),
        st.quarantine,
        st.backoff,
    )


def _set(values: Iterable[Any]) -> frozenset[Any]:
    """A set of distinct values.  Raises ValueError for a duplicate."""
    listed = list(values)
    if len(made := frozenset(listed)) < len(listed):
        raise ValueError(f"duplicate value in {listed}")
    return made


# -- inputs and effects in the specification's form


def abstract_input(me: Me, st: State, i: Input) -> spec.Input:
    """The specification's input for an input of the reference in this state."""
    match i:
        case Received(message, planned):
            return spec.Receive("receive", _received(st, message), planned is not None)
        case ReceivedCam(cam, at_ms):
            newer = True
            if st.heard_ms is not None and st.first_cam_ms is not None:
                generated, received = st.first_cam_ms
                lead = cam_lead(me.clock_drift, me.t_resend, at_ms - received)
                newer = st.heard_ms < cam.generation_ms <= generated + lead
            return spec.Cam("cam", cam.src, frozenset(cam.marks), newer)
        case Expiry(timer):
            return spec.Expire("expire", _abstract_timer(timer, st))
        case Restart():
            return spec.Restart("restart")
    about = getattr(i, "proposal", 0), getattr(i, "target", 0)
    return spec.Command("command", i.name, getattr(i, "session", (0, 0)), *about)


def _received(st: State, m: Message) -> spec.Message:
    """A received message.  An Ack names an entry of the outbox, or -seq if there is none."""
    described = _described(m)
    if m.seq and described.reason != "none":
        described = described._replace(reason="as_sent")
    if isinstance(m, Ack):
        named = EntryKey(m.of.type, m.src, m.session, m.of.seq)
        entry = next((e for e in st.outbox if key(e) == named), None)
        described = described._replace(of=(m.of.type, _number(entry) if entry else -m.of.seq))
    return described


def _described(m: Message) -> spec.Message:
    """A message of the specification, without the message that an Ack names."""
    accepted = isinstance(m, Acceptance) and m.accepted
    reason = getattr(m, "reason", None) or "none"
    proposal = m.proposal if isinstance(m, Prescription | Acceptance) else 0
    about = proposal, accepted, reason, ("none", 0)
    return spec.Message(m.type, m.src, m.dst, m.session, _number(m), *about)


Answer = tuple[list[spec.Message], tuple[str, ...], list[spec.Timer], list[spec.Timer]]
"""Messages, indication, timers armed and timers stopped."""


def answer(before: State, given: Message | None, effects: Effects) -> Answer:
    """These effects in the specification's form; ``given`` is the received message."""
    messages = [_sent(before, given, m) for m in effects.messages]
    indicated: tuple[str, ...] = ("nothing",)
    for indication in effects.indications:
        indicated = _abstract_indication(indication, given)
    arm = [_abstract_timer(t, effects.state) for t, _ in effects.armed]
    stop = [_abstract_timer(t, before) for t in effects.stopped]
    return messages, indicated, arm, stop


def is_copy(before: State, m: Message) -> bool:
    """Whether it equals a message that is already being sent reliably or broadcast."""
    return m in before.outbox or m == before.advertisement


def _sent(before: State, given: Message | None, m: Message) -> spec.Message:
    described, copy = _described(m), is_copy(before, m)
    if isinstance(m, Ack):
        named = given is not None and m.of == MessageId(type=given.type, seq=given.seq)
        described = described._replace(of=(m.of.type, _number(given) if given and named else WRONG))
    if m.seq and not copy and m.seq <= before.seq and not isinstance(m, Intention):
        described = described._replace(seq=WRONG)  # new content takes a new seq
    if copy and described.reason != "none":
        described = described._replace(reason="as_sent")
    return described


def _abstract_indication(indication: Indication, given: Message | None) -> tuple[str, ...]:
    if not isinstance(indication, Fallback):
        return (indication.name,)
    reason = indication.reason
    passed_on = isinstance(given, Cancel) and given.seq and reason == given.reason
    return "fallback", "as_sent" if passed_on else str(reason)


def _abstract_timer(timer: Timer, st: State) -> spec.Timer:
    if timer.name == "forget":
        return "forget", timer.station
    if timer.entry is None:
        return (timer.name,)
    if timer.entry.type == "Advertisement":
        return timer.name, spec.Entry("Advertisement", 0, timer.entry.session, 1, False)
    return timer.name, _entry_of(st, timer.entry)


def _entry_of(st: State, wanted: EntryKey) -> spec.Entry:
    unknown = spec.Entry(f"unknown {wanted.type}", *wanted[1:], False)
    return next((abstract_entry(m) for m in st.outbox if key(m) == wanted), unknown)


class Reference:
    """A station that can be put into a state, takes an input and returns the answer."""

    def __init__(self, constants: Mapping[str, Any], rules: Rules = RULES) -> None:
        parameters = Parameters(
            max_rounds=constants["MaxRounds"],
            max_participants=constants["MaxParticipants"],
            outbox_limit=constants["OutboxLimit"],
            memory_limit=constants["MemoryLimit"],
        )
        self._base: tuple[State, spec.State] | None = None
        self._armed: dict[Timer, int] = {}
        self._plan: Trajectory | None = None
        self.station = Station(ME, parameters, plan=lambda _: self._plan, rules=rules)

    def put(self, state: spec.State) -> None:
        """Enter this state of the specification, with its timers running."""
        self.put_state(concrete(state))

    def put_state(self, state: State) -> None:
        """Enter this reference state, which was reached before."""
        if self._base is None or state is not self._base[0]:
            self._base = state, abstract(state)
            self._armed = dict.fromkeys(armed(ME, state), LATER)
        self.station.state = state
        self.station.timers = self._armed.copy()
        self.station._now = 0

    def state(self) -> spec.State:
        """The current state in the specification's form."""
        state = self.station.state
        return self._base[1] if self._base and state is self._base[0] else abstract(state)

    def marks(self) -> frozenset[spec.Session]:
        """The sessions that its CAM would name."""
        return _set(self.station.state.marks)

    def apply(self, value: spec.Input) -> Answer:
        """Apply one input and return the answer."""
        before = self.station.state
        given, (only,) = self.give(value)
        return answer(before, given, only)

    def give(self, value: spec.Input) -> tuple[Message | None, list[Effects]]:
        """Give one input to the station.  Returns its message, if it has one, and the effects."""
        station = self.station
        match value:
            case spec.Receive():
                given = self.message(value.message)
                self._plan = PLANNED if value.concerned else None
                return given, station.receive(given, NOW)
            case spec.Cam():
                return None, station.receive(self._cam(value), NOW)
            case spec.Command():
                return None, station.command(self._command(value), NOW)
            case spec.Expire():
                station.timers[self._timer(value.timer)] = NOW
                return None, station.advance(NOW)
        return None, station.restart(NOW)

    # -- inputs

    def message(self, value: spec.Message) -> Any:
        """A received message, with content."""
        if value.type != "Ack":
            return _message(value, 100 + value.seq if value.seq else 0)
        of_type, of_k = value.of
        of_seq = 0 if of_k == 0 else self._acked_seq(value.src, value.session, of_type, of_k)
        return _message(value._replace(of=(of_type, of_seq)), 0)

    def _acked_seq(self, src: int, session: spec.Session, type_: str, k: int) -> int:
        """The seq of the named entry; without one, of another entry to that station, as a test."""
        others = [m for m in self.station.state.outbox if m.dst == src and m.session == session]
        for m in others:
            if (m.type, _number(m)) == (type_, k):
                return m.seq
        return next((m.seq for m in others if m.type != type_), UNUSED_SEQ)

    def _cam(self, value: spec.Cam) -> Cam:
        last = self.station.state.heard_ms or CAM_MS
        return Cam(
            src=value.src,
            generation_ms=last + 100 if value.newer else last,
            x_mm=0,
            y_mm=0,
            heading_mrad=0,
            speed_mm_s=8333,
            marks=tuple(sorted(value.marks)),
        )

    def _command(self, value: spec.Command) -> Any:
        _, name, session, proposal, target = value
        fields: dict[str, Any] = {"name": name}
        if name == "request":
            fields |= {"scenario": "lane_change", "details": {}}
        else:
            fields |= {"session": session}
        if name in ("prescribe", "accept", "refuse"):
            fields |= {"proposal": proposal}
        if name == "prescribe":
            fields |= {"target": target} | PRESCRIBES
        if name == "accept":
            fields |= {"selected": PRESCRIBED}
        return COMMAND.validate_python(fields)

    def _timer(self, value: spec.Timer) -> Timer:
        """The armed timer with this value in the specification."""
        for timer in self.station.timers:
            if _abstract_timer(timer, self.station.state) == value:
                return timer
        raise LookupError(f"the timer is not armed: {value}")


def without(rule: str) -> Rules:
    """The rules with the rows of one removed, so that later rows decide; "": all.

    END-4 has no row of its own but is the guard of many rows: without it, any session of the same
    prescriber counts as the own one.
    """
    if rule == "END-4":
        return {kind: tuple(map(_loose, rows)) for kind, rows in RULES.items()}
    return {kind: tuple(row for row in rows if row.rule != rule) for kind, rows in RULES.items()}


def _loose(row: Row[_Input]) -> Row[_Input]:
    """The row with a guard that ignores the session number if the prescriber is the same."""

    def when(me: Me, st: State, i: _Input) -> bool:
        if isinstance(i, Received) and st.session and st.session[0] == i.message.session[0]:
            st = st._replace(session=i.message.session)
        return row.when(me, st, i)

    return row._replace(when=when)
