"""The state of a station while its log is checked, and conversions between log and specification.

The specification keeps only part of each message (docs/protocol.md, "What the specification keeps
of a message"): its ``seq`` is the proposal, 1, or 0 for an answer. ``Track`` keeps the rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple, get_args

from automcm_spec.log_format.log import (
    CamFields,
    Command,
    Event,
    ForgetTimer,
    MessageKey,
    MessageTimer,
    PlainTimer,
    Receive,
    Timer,
)
from automcm_spec.vocabulary import station as spec
from automcm_spec.vocabulary.messages import (
    ANSWER_REASONS,
    Acceptance,
    Ack,
    Advertisement,
    Cancel,
    Fields,
    Message,
    MessageId,
    Prescription,
    encode,
    same,
    to_dict,
)
from automcm_spec.vocabulary.parameters import DEFAULTS, LIMITS, Known, cam_lead
from automcm_spec.vocabulary.rules import RULES, handler, line
from automcm_spec.vocabulary.station import Entry, Input, State, Station

NUMBERED = tuple(m.__name__ for m in get_args(Message) if "proposal" in m.model_fields)
"""The message types whose seq in the specification is the proposal."""
CONTENT = ("scenario", "details", "planned", "prescribed", "hold_ms", "lease_ms", "selected")
"""The fields of messages that the application gives and the station only carries."""
REASONS = ("none", *ANSWER_REASONS)
"""The reasons that the specification distinguishes; it passes on all others unchanged."""
UNBOUND = (0, 0)
"""The session of a station that is in no session."""


class CannotTell(Exception):
    """The log does not contain enough for a verdict; the text says why."""


class OutboxEntry(NamedTuple):
    """A reliable message that is still being sent."""

    spec: Entry
    """The entry as a value of the specification."""
    message: Message


class Quarantine(NamedTuple):
    """Why and since when a station is in quarantine."""

    line: int
    """The line of the input that began it."""
    rule: str
    """END-8 after a restart, ACT-6 after a commitment that the station broke off."""
    lasts_ms: int | None


Limits = tuple[int, int, int, int]
"""The values of LIMITS."""


def limits_of(known: Known) -> Limits:
    """The limits among these parameters, by default those of the protocol."""
    rounds, participants, outbox, memory = (known.get(name, DEFAULTS[name]) for name in LIMITS)
    return rounds, participants, outbox, memory


DEFAULT_LIMITS = limits_of({})
_STATION = Station(*DEFAULT_LIMITS)
INITIAL, NO_INDICATION = _STATION.initial, _STATION.nothing
PHASES, ROLES = tuple(sorted(_STATION.phases)), tuple(sorted(_STATION.roles))
_marks = lru_cache(1000)(_STATION.marks)


def _about(m: Message) -> tuple[int, bool, str]:
    """The proposal, the accepted flag and the reason of a message, or defaults."""
    match m:
        case Prescription():
            return m.proposal, False, "none"
        case Acceptance():
            return m.proposal, m.accepted, m.reason or "none"
        case Cancel():
            return 0, False, m.reason
    return 0, False, "none"


def _copy_difference(first: Message, m: Message) -> str | None:
    if encode(first) == encode(m):
        return None
    one, other = to_dict(first), to_dict(m)
    for name in sorted({*one, *other}):
        if not same(one.get(name), other.get(name)):
            return f"{name}: differs from the first copy; a copy must repeat it byte for byte"
    return None


class Expected(NamedTuple):
    """A message that the specification expects the station to send."""

    value: spec.Message
    """The message as a value of the specification."""
    of: tuple[str, int | None] | None
    """The message that an Ack names; its seq is None if that message was not observed."""
    copy_of: OutboxEntry | None

    @property
    def is_new(self) -> bool:
        """Whether it is a new reliable message."""
        return bool(self.value.seq) and self.copy_of is None

    def __str__(self) -> str:
        m = self.value
        extra = [f"proposal={m.proposal}"] if m.proposal else []
        if m.type == "Acceptance":
            extra.append("accepted" if m.accepted else "refused")
        if m.reason not in ("none", "as_sent"):
            extra.append(m.reason)
        if self.of:
            extra.append(f"of {self.of[0]} seq={self.of[1]}")
        if self.copy_of:
            extra.append(f"copy of seq={self.copy_of.message.seq}")
        to = f" to {m.dst}" if m.dst else ""
        inner = f" ({', '.join(extra)})" if extra else ""
        return f"{m.type}{to} session={m.session[0]}/{m.session[1]}{inner}"

    def difference(self, m: Message, t: Track, content: Fields, fresh: int) -> str | None:
        """The first difference of the logged message ``m`` from this one; None if they agree.

        ``content`` comes from the application; ``fresh`` counts the new messages sent in this step.
        """
        proposal, accepted, reason = _about(m)
        plain = (
            ("type", self.value.type, m.type),
            ("src", t.me, m.src),
            ("dst", self.value.dst, m.dst),
            ("session", list(self.value.session), list(m.session)),
            ("proposal", self.value.proposal, proposal),
            ("accepted", self.value.accepted, accepted),
        )
        for name, wanted, found in plain:
            if wanted != found and not (name == "session" and self._opens(m, t)):
                return f"{name}: expected {wanted}, got {found}"
        if self.copy_of is not None:
            return _copy_difference(self.copy_of.message, m)
        if self.value.reason not in ("none", reason):
            return f"reason: expected {self.value.reason}, got {reason}"
        if self.of and isinstance(m, Ack):
            type_, seq = self.of
            if m.of.type != type_ or seq not in (None, m.of.seq):
                return f"of: expected {type_} seq={seq}, got {m.of.model_dump()}"
        if self.value.seq == 0 and m.seq != 0:
            return f"seq: an answer must have seq 0, not {m.seq} (END-6)"
        if self.value.seq and m.seq != t.seq + fresh + 1:
            return f"seq: a new message must take the next seq, {t.seq + fresh + 1}, not {m.seq}"
        fields = to_dict(m) if content else {}
        for name in [name for name in CONTENT if name in content and name in type(m).model_fields]:
            if not same(content[name], fields.get(name)):
                return f"{name}: differs from the value that the application gave"
        return None

    def mismatch(self, m: Fields) -> int:
        """1, plus the number of fields in which the logged message ``m`` differs from this one. The
        seq and the content, which are not compared here, account for the 1."""
        v = self.value
        right: dict[str, object] = {"dst": v.dst, "session": [*v.session], "proposal": v.proposal}
        right |= {"accepted": v.accepted, "reason": v.reason if v.reason != "none" else None}
        found = {"dst": 0, "proposal": 0, "accepted": False, **m}
        return 1 + len([name for name, value in right.items() if found.get(name) != value])

    def _opens(self, m: Message, t: Track) -> bool:
        """Whether the message opens a new session, which may take any number above the last one."""
        new = self.value.type == "Advertisement" and self.copy_of is None
        return new and m.session[0] == t.me and m.session[1] > t.state.number


class SpecInput(NamedTuple):
    """An input for the specification."""

    value: Input
    what: str
    """The input as text."""
    given: Message | CamFields | None = None
    """The received message, if the input is one that was observed."""
    content: Mapping[str, object] = {}
    """Content from the application, which the station must send unchanged."""


@dataclass(slots=True)
class Track:
    """The known state of a station: the specification's state with real ids and message content."""

    me: int
    limits: Limits = DEFAULT_LIMITS
    t_resend: int = DEFAULTS["t_resend"]
    clock_drift: int = 0
    state: State = INITIAL
    outbox: list[OutboxEntry] = field(default_factory=list)
    """The entries of the state's outbox with their messages, in sending order."""
    advertisement: Message | None = None
    last_cam_ms: int | None = None
    """``generation_ms`` of the last CAM that counted (ACT-5); None if there was none."""
    last_cam_line: int = 0
    first_cam_ms: tuple[int, int] | None = None
    """When the first CAM that counted was generated and received; None if unknown."""
    seq: int = 0
    """The last seq used in the session."""
    lease_ms: int = 0
    quarantine: Quarantine | None = None
    """The last one."""

    def copy(self) -> Track:
        """A copy that can change independently; ``replace`` would take several times as long."""
        s, sent = self, list(self.outbox)
        fixed = s.me, s.limits, s.t_resend, s.clock_drift
        cams = s.last_cam_ms, s.last_cam_line, s.first_cam_ms
        return Track(*fixed, s.state, sent, s.advertisement, *cams, s.seq, s.lease_ms, s.quarantine)

    def key(self) -> tuple[object, ...]:
        """A hashable value that identifies this state."""
        cams = self.last_cam_ms, self.first_cam_ms
        return self.state, tuple(e.spec for e in self.outbox), cams, self.seq

    @property
    def session(self) -> tuple[int, int] | None:
        """The session of the station; None if it is in no session."""
        return None if self.state.session == UNBOUND else self.state.session

    @property
    def peer(self) -> int:
        """The other station of the session; 0 if there is none."""
        st = self.state
        return st.session[0] if st.role == "receiver" else st.target

    @property
    def marks(self) -> frozenset[tuple[int, int]]:
        """The sessions that the station's CAM must name (ACT-5)."""
        return _marks(self.state)

    def entry_of(
        self, key: MessageKey | MessageId, to: int, session: spec.Session
    ) -> OutboxEntry | None:
        """The outbox entry that a timer or an Ack names by its seq on the wire."""
        named = (key.type, to, session), key.seq
        found = (e for e in self.outbox if (e.spec[:3], e.message.seq) == named)
        return next(found, None)

    def advance(self, after: State, sent: Iterable[tuple[Expected, Message]]) -> None:
        """Move to the next state, with the messages that were actually sent."""
        if after.session != self.state.session:
            self.seq = 0
        self.state = after
        if after.phase != "ADVERTISING":
            self.advertisement = None
        if not after.proposal:
            self.lease_ms = 0
        if not after.heard:
            self.last_cam_ms = self.first_cam_ms = None
        self.outbox = [e for e in self.outbox if e.spec in after.outbox]
        for e, m in sent:
            if isinstance(m, Advertisement):  # its session may have any number above the last one
                me, number = self.me, m.session[1]
                self.state = after._replace(session=(me, number), number=number)
                self.advertisement = m
            elif e.is_new:
                self.outbox.append(OutboxEntry(_STATION.entry(e.value), m))
            if e.is_new and self.session is not None:
                self.seq = max(self.seq, m.seq)
            if isinstance(m, Prescription) and e.copy_of is None:
                self.lease_ms = m.lease_ms

    def expected(self, m: spec.Message, i: Input, given: Message | CamFields | None) -> Expected:
        """An expected effect of the input ``i``; ``given`` is the received message, if observed."""
        of = None
        if m.type == "Ack" and i.kind == "receive":
            seq = given.seq if given is not None and not isinstance(given, CamFields) else None
            of = i.message.type, seq if i.message.seq else 0
        entry = _STATION.entry(m)
        copy = next((e for e in self.outbox if e.spec == entry), None) if m.seq else None
        if m.type == "Advertisement" and self.advertisement is not None:
            copy = OutboxEntry(entry, self.advertisement)
        return Expected(m, of, copy)

    # -- inputs

    def is_newer(self, m: CamFields, t_ms: int) -> bool:
        """Whether a CAM received at ``t_ms`` was generated after the last that counted, and is not
        too far ahead (ACT-5)."""
        if self.last_cam_ms is not None and m["generation_ms"] <= self.last_cam_ms:
            return False
        most = self.latest_cam(t_ms)
        return most is None or bool(m["generation_ms"] <= most)

    def cam_received(self, m: CamFields, src: int, marks: bool, newer: bool) -> SpecInput:
        """The input for a CAM; ``marks``: it marks the station's session."""
        marked = frozenset({self.state.session} if marks else ())
        return SpecInput(spec.Cam("cam", src, marked, newer), f"receive CAM from {src}", m)

    def received(self, event: Receive, m: Message) -> SpecInput:
        """The input for a received message other than a CAM."""
        of = ("none", 0)
        if isinstance(m, Ack):  # it names an outbox entry, or a message that matches none (END-6)
            entry = self.entry_of(m.of, m.src, m.session) if m.of.seq else None
            of = (entry.spec.type, entry.spec.seq) if entry is not None else ("Cancel", 0)
        proposal, accepted, reason = _about(m)
        reason = reason if reason in REASONS else "as_sent"
        ids = m.type, m.src, m.dst, m.session
        number = proposal or 1 if m.seq else 0  # an answer has none
        message = spec.Message(*ids, number, proposal, accepted, reason, of)
        content = {} if event.planned is None else {"planned": event.planned}
        what = f"receive {m.type} from {m.src}"
        return SpecInput(spec.Receive("receive", message, bool(content)), what, m, content)

    def expired(self, timer: Timer) -> SpecInput | None:
        """The input for the expiry of an armed timer; None if its message is not in the outbox."""
        value = self.timer_of(timer)
        what = f"expire {timer_name(timer)}"
        return None if value is None else SpecInput(spec.Expire("expire", value), what)

    def latest_cam(self, t_ms: int) -> int | None:
        """The greatest ``generation_ms`` with which a CAM received at ``t_ms`` counts (ACT-5.3);
        None if unknown."""
        if self.first_cam_ms is None:
            return None
        generated, received_ms = self.first_cam_ms
        return generated + cam_lead(self.clock_drift, self.t_resend, t_ms - received_ms)

    # -- timers

    def timer_of(self, timer: Timer) -> spec.Timer | None:
        """A logged timer as a value of the specification; None if its message is neither the
        Advertisement nor in the outbox."""
        match timer:
            case MessageTimer(message=MessageKey(type="Advertisement")):
                return timer.name, spec.Entry("Advertisement", 0, self.state.session, 1, False)
            case MessageTimer(message=MessageKey() as m):
                entry = self.entry_of(m, m.to or 0, m.session)
                return None if entry is None else (timer.name, entry.spec)
            case ForgetTimer(station=int(station)):
                return timer.name, station
        return (timer.name,)

    def named(self, sent: Sequence[tuple[Expected, Message]], timer: spec.Timer) -> Timer:
        """A timer of the specification as a log names it; ``sent`` are the messages of the step. No
        log names it before its message was sent."""
        name: Any = timer[0]
        match timer:
            case (_, spec.Entry(type=type_, to=to) as entry):
                messages = [e.message for e in self.outbox if e.spec == entry]
                messages += [m for e, m in sent if _STATION.entry(e.value) == entry]
                if type_ == "Advertisement" and self.advertisement is not None:
                    messages.append(self.advertisement)
                session, seq = (messages[0].session, messages[0].seq) if messages else (UNBOUND, -1)
                return _message_timer(name, type_, to or None, session, seq)
        return _other_timer(name, *timer[1:])


@dataclass(slots=True)
class InputStep:
    """An input and the effects that are still expected."""

    at: int
    t_ms: int
    event: Event | None
    """The input as logged; None if it was not observed."""
    input: Input
    """The input as a value of the specification."""
    what: str
    rule: str
    """The rule that decides the input."""
    after: State
    """The next state."""
    changes: bool
    """Whether the state or a timer changes."""
    indication: tuple[str, ...]
    """The indication to the application, with its reason."""
    messages: list[Expected]
    arm: list[spec.Timer]
    stop: list[spec.Timer]
    indications: list[str]
    given: Message | CamFields | None
    content: Fields
    since_ms: int
    """The earliest time of the input; ``t_ms`` is the latest, and equal for an observed input."""
    unseen: bool = False
    """Whether neither the input nor an effect has been observed so far."""
    fresh: int = 0
    sent: list[tuple[Expected, Message]] = field(default_factory=list)

    @property
    def moves(self) -> bool:
        """Whether the state or a timer changes, or messages were sent."""
        return self.changes or bool(self.sent)

    @property
    def guard(self) -> str:
        """The rule, its meaning, and its location in Station.tla."""
        rule = self.rule
        where = line(rule, self.input)
        return f"{rule}: {RULES.get(rule, '')} ({handler(self.input)}, Station.tla:{where})"

    def copy(self) -> InputStep:
        """A copy for a copied station; ``replace`` would take several times as long."""
        s = self
        decided = s.at, s.t_ms, s.event, s.input, s.what, s.rule, s.after, s.changes, s.indication
        effects = list(s.messages), list(s.arm), list(s.stop), list(s.indications)
        since = s.since_ms, s.unseen, s.fresh, list(s.sent)
        return InputStep(*decided, *effects, s.given, s.content, *since)


RESTARTED = SpecInput(spec.Restart("restart"), "restart")


def commanded(command: Command) -> SpecInput:
    """The input for a command of the application."""
    given = command.model_extra or {}
    session, proposal = tuple(given.get("session") or UNBOUND), given.get("proposal", 0)
    value = spec.Command("command", command.name, session, proposal, given.get("target", 0))
    return SpecInput(value, f"command {command.name}", None, given)


def timer_name(timer: Timer) -> str:
    """A logged timer as text."""
    match timer:
        case MessageTimer(message=MessageKey() as m):
            return f"{timer.name}({m.type} seq={m.seq} to {m.to or 'all'})"
        case ForgetTimer(station=int(station)):
            return f"{timer.name}({station})"
    return timer.name


def armed_name(timer: Timer) -> str:
    """A logged timer as text, with the session of its message."""
    m = timer.message if isinstance(timer, MessageTimer) else None
    return timer_name(timer) + (f" session={m.session[0]}/{m.session[1]}" if m else "")


@lru_cache(1000)
def _message_timer(name: Any, type_: str, to: int | None, session: Any, seq: int) -> MessageTimer:
    key = MessageKey.model_construct(type=type_, to=to, session=session, seq=seq)
    return MessageTimer.model_construct(name=name, message=key)


@lru_cache(1000)
def _other_timer(name: Any, station: Any = None) -> ForgetTimer | PlainTimer:
    if station is None:
        return PlainTimer.model_construct(name=name)
    return ForgetTimer.model_construct(name=name, station=station)


def short(timer: spec.Timer) -> str:
    """A timer of the specification as text."""
    return f"{timer[0]}({timer[1].type})" if isinstance(timer[-1], spec.Entry) else timer[0]
