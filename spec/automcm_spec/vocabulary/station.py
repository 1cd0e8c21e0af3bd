"""Station.tla and OpenStation.tla as Python.  Generated: do not edit, run make generate.

Each method is the operator of that name, each class of records a NamedTuple.  Sets are frozensets;
tuples are tuples, whose elements count from 0 here (automcm_maintenance.compilation.compiler).
"""

# The compiler knows which form of tuple is left where an element is read; mypy does not.
# mypy: disable-error-code="arg-type, misc"

from __future__ import annotations

from functools import cached_property
from itertools import chain, product
from typing import Literal, NamedTuple, TypeAlias

from automcm_spec.vocabulary.conditions import EMPTY, Condition, NoArm


class State(NamedTuple):
    """Station.tla:46."""

    phase: str
    role: str
    session: Session
    recorded: frozenset[int]
    withdrawn: frozenset[int]
    target: int
    proposal: int
    deciding: bool
    heard: bool
    number: int
    joined: frozenset[Session]
    outbox: frozenset[Entry]
    quarantine: bool
    backoff: bool


class Message(NamedTuple):
    """Station.tla:68."""

    type: str
    src: int
    dst: int
    session: Session
    seq: int
    proposal: int
    accepted: bool
    reason: str
    of: tuple[str, int]


class Receive(NamedTuple):
    """OpenStation.tla:81."""

    kind: Literal["receive"]
    message: Message
    concerned: bool


class Cam(NamedTuple):
    """OpenStation.tla:84."""

    kind: Literal["cam"]
    src: int
    marks: frozenset[Session]
    newer: bool


class Command(NamedTuple):
    """OpenStation.tla:90."""

    kind: Literal["command"]
    name: str
    session: Session
    proposal: int
    target: int


class Entry(NamedTuple):
    """Station.tla:94."""

    type: str
    to: int
    session: Session
    seq: int
    accepted: bool


class Expire(NamedTuple):
    """OpenStation.tla:129."""

    kind: Literal["expire"]
    timer: Timer


class Restart(NamedTuple):
    """OpenStation.tla:130."""

    kind: Literal["restart"]


class Effect(NamedTuple):
    """Station.tla:144."""

    st: State
    out: frozenset[Message]
    told: tuple[str, ...]
    rule: str
    again: frozenset[Timer]


class Outcome(NamedTuple):
    """Station.tla:539."""

    st: State
    out: frozenset[Message]
    told: tuple[str, ...]
    rule: str
    arm: frozenset[Timer]
    stop: frozenset[Timer]


Session: TypeAlias = tuple[int, int]


Timer: TypeAlias = tuple[str, Entry] | tuple[str, int] | tuple[str]


Input: TypeAlias = Cam | Command | Expire | Receive | Restart


class Station:
    """The operators of Station.tla with these constants."""

    def __init__(
        self, max_rounds: int, max_participants: int, outbox_limit: int, memory_limit: int
    ) -> None:
        self.max_rounds = max_rounds
        self.max_participants = max_participants
        self.outbox_limit = outbox_limit
        self.memory_limit = memory_limit

    @cached_property
    def nobody(self) -> int:
        """Station.tla:34."""
        return 0

    @cached_property
    def broadcast(self) -> int:
        """Station.tla:35."""
        return 0

    @cached_property
    def no_session(self) -> Session:
        """Station.tla:36."""
        return (0, 0)

    @cached_property
    def phases(self) -> frozenset[str]:
        """Station.tla:38."""
        return frozenset(
            {
                "STANDALONE",
                "ADVERTISING",
                "CHOOSING",
                "PRESCRIBING",
                "INTENDING",
                "WAITING",
                "NEGOTIATING",
                "ACTUATING",
            }
        )

    @cached_property
    def roles(self) -> frozenset[str]:
        """Station.tla:40."""
        return frozenset({"none", "prescriber", "receiver"})

    @cached_property
    def initial(self) -> State:
        """Station.tla:45."""
        return State(
            phase="STANDALONE",
            role="none",
            session=self.no_session,
            recorded=EMPTY,
            withdrawn=EMPTY,
            target=self.nobody,
            proposal=0,
            deciding=False,
            heard=False,
            number=0,
            joined=EMPTY,
            outbox=EMPTY,
            quarantine=False,
            backoff=False,
        )

    def bound(self, st: State) -> bool:
        """Station.tla:61."""
        return st.phase != "STANDALONE"

    def peer(self, st: State) -> int:
        """Station.tla:62."""
        if st.role == "receiver":
            return st.session[0]
        return st.target

    def message(self, type: str, src: int, dst: int, session: Session, seq: int) -> Message:
        """Station.tla:67."""
        return Message(
            type=type,
            src=src,
            dst=dst,
            session=session,
            seq=seq,
            proposal=0,
            accepted=False,
            reason="none",
            of=("none", 0),
        )

    def advertisement(self, me: int, s: Session) -> Message:
        """Station.tla:72."""
        return self.message("Advertisement", me, self.broadcast, s, 1)

    def intention(self, me: int, s: Session) -> Message:
        """Station.tla:73."""
        return self.message("Intention", me, s[0], s, 1)

    def prescription(self, me: int, to: int, s: Session, k: int) -> Message:
        """Station.tla:74."""
        return self.message("Prescription", me, to, s, k)._replace(proposal=k)

    def acceptance(self, me: int, s: Session, k: int) -> Message:
        """Station.tla:76."""
        return self.message("Acceptance", me, s[0], s, k)._replace(proposal=k, accepted=True)

    def refusal(self, me: int, s: Session, k: int, why: str) -> Message:
        """Station.tla:79."""
        return self.message("Acceptance", me, s[0], s, k)._replace(proposal=k, reason=why)

    def fin(self, me: int, to: int, s: Session) -> Message:
        """Station.tla:81."""
        return self.message("Fin", me, to, s, 1)

    def cancel(self, me: int, to: int, s: Session, why: str) -> Message:
        """Station.tla:82."""
        return self.message("Cancel", me, to, s, 1)._replace(reason=why)

    def answer_seq(self, seq: int) -> int:
        """Station.tla:86."""
        return 0

    def ack(self, me: int, m: Message) -> Message:
        """Station.tla:87."""
        return self.message("Ack", me, m.src, m.session, 0)._replace(of=(m.type, m.seq))

    def refusal_answer(self, me: int, m: Message, why: str) -> Message:
        """Station.tla:89."""
        return self.refusal(me, m.session, m.proposal, why)._replace(
            seq=self.answer_seq(m.proposal)
        )

    def closed(self, me: int, m: Message) -> Message:
        """Station.tla:91."""
        return self.cancel(me, m.src, m.session, "closed")._replace(seq=self.answer_seq(1))

    def entry(self, m: Message) -> Entry:
        """Station.tla:94."""
        return Entry(type=m.type, to=m.dst, session=m.session, seq=m.seq, accepted=m.accepted)

    def copy(self, me: int, e: Entry) -> Message:
        """Station.tla:97."""
        return self.message(e.type, me, e.to, e.session, e.seq)._replace(
            proposal=e.seq if e.type in {"Prescription", "Acceptance"} else 0,
            accepted=e.accepted,
            reason="as_sent"
            if e.type == "Cancel" or (e.type == "Acceptance" and (not e.accepted))
            else "none",
        )

    def timer(self, name: str) -> Timer:
        """Station.tla:109."""
        return (name,)

    def resend(self, e: Entry) -> Timer:
        """Station.tla:110."""
        return ("resend", e)

    def give_up(self, e: Entry) -> Timer:
        """Station.tla:111."""
        return ("giveup", e)

    def forget(self, p: int) -> Timer:
        """Station.tla:112."""
        return ("forget", p)

    def lease_runs(self, st: State) -> bool:
        """Station.tla:114."""
        return st.phase in {"PRESCRIBING", "ACTUATING"} or (
            st.phase == "NEGOTIATING" and st.role == "prescriber" and (not st.deciding)
        )

    def if_(self, condition: bool, timers: frozenset[Timer]) -> frozenset[Timer]:
        """Station.tla:118."""
        if condition:
            return timers
        return EMPTY

    def armed(self, me: int, st: State) -> frozenset[Timer]:
        """Station.tla:120."""
        return (
            (
                frozenset(
                    {
                        self.timer("advertise"),
                        self.resend(self.entry(self.advertisement(me, st.session))),
                    }
                )
                if st.phase == "ADVERTISING"
                else EMPTY
            )
            | (
                frozenset({self.timer("decide")})
                if st.phase == "CHOOSING"
                or (st.phase == "NEGOTIATING" and (st.role == "receiver" or st.deciding))
                else EMPTY
            )
            | (frozenset({self.timer("hold")}) if st.phase == "WAITING" else EMPTY)
            | (
                frozenset({self.timer("answer")})
                if st.phase == "NEGOTIATING" and st.role == "prescriber" and (not st.deciding)
                else EMPTY
            )
            | (frozenset({self.timer("cam")}) if st.phase == "ACTUATING" else EMPTY)
            | (frozenset({self.timer("lease")}) if self.lease_runs(st) else EMPTY)
            | frozenset({self.give_up(e) for e in st.outbox})
            | frozenset({self.resend(e) for e in st.outbox})
            | (frozenset({self.timer("quarantine")}) if st.quarantine else EMPTY)
            | (frozenset({self.timer("backoff")}) if st.backoff else EMPTY)
            | frozenset({self.forget(s[0]) for s in (x for x in st.joined if x != st.session)})
        )

    @cached_property
    def nothing(self) -> tuple[str]:
        """Station.tla:141."""
        return ("nothing",)

    def effect(
        self, st: State, out: frozenset[Message], told: tuple[str, ...], rule: str
    ) -> Effect:
        """Station.tla:143."""
        return Effect(st=st, out=out, told=told, rule=rule, again=EMPTY)

    def ignore(self, st: State, rule: str) -> Effect:
        """Station.tla:146."""
        return self.effect(st, EMPTY, self.nothing, rule)

    def answer(self, st: State, m: Message, rule: str) -> Effect:
        """Station.tla:147."""
        return self.effect(st, frozenset({m}), self.nothing, rule)

    def discard(self, st: State, rule: str) -> Effect:
        """Station.tla:148."""
        return self.effect(st, EMPTY, ("discarded",), rule)

    def refuse(self, st: State, rule: str) -> Effect:
        """Station.tla:149."""
        return self.effect(st, EMPTY, ("refused",), rule)

    def post(self, st: State, ms: frozenset[Message]) -> State:
        """Station.tla:152."""
        return st._replace(outbox=st.outbox | frozenset({self.entry(m) for m in ms}))

    def drop(self, st: State, e: Entry) -> State:
        """Station.tla:153."""
        return st._replace(outbox=st.outbox - frozenset({e}))

    def leave(self, st: State) -> State:
        """Station.tla:157."""
        return st._replace(
            phase="STANDALONE",
            role="none",
            session=self.no_session,
            recorded=EMPTY,
            withdrawn=EMPTY,
            target=self.nobody,
            proposal=0,
            deciding=False,
            heard=False,
            outbox=frozenset({e for e in st.outbox if e.type in {"Fin", "Cancel"}}),
        )

    def break_off(self, st: State) -> State:
        """Station.tla:165."""
        if st.phase == "ACTUATING" and st.role == "receiver":
            return self.leave(st)._replace(quarantine=True)
        return self.leave(st)

    def leave_with(
        self, st: State, ms: frozenset[Message], told: tuple[str, ...], rule: str
    ) -> Effect:
        """Station.tla:169."""
        return self.effect(self.post(self.break_off(st), ms), ms, told, rule)

    def cancels(self, me: int, st: State, to: frozenset[int], why: str) -> frozenset[Message]:
        """Station.tla:171."""
        return frozenset({self.cancel(me, p, st.session, why) for p in to})

    def cancel_peer(self, me: int, st: State, why: str, rule: str) -> Effect:
        """Station.tla:174."""
        return self.leave_with(
            st, self.cancels(me, st, frozenset({self.peer(st)}), why), ("fallback", why), rule
        )

    def others(self, st: State) -> frozenset[int]:
        """Station.tla:178."""
        if st.phase in {"ADVERTISING", "CHOOSING"}:
            return st.recorded
        return frozenset({self.peer(st)})

    def same_session(self, s: Session, t: Session) -> bool:
        """Station.tla:185."""
        return s == t

    def of_peer(self, st: State, src: int) -> bool:
        """Station.tla:186."""
        return src == self.peer(st)

    def same_proposal(self, k: int, l_: int) -> bool:
        """Station.tla:187."""
        return k == l_

    def older_or_same(self, k: int, l_: int) -> bool:
        """Station.tla:188."""
        return k <= l_

    def ack_matches(self, e: Entry, m: Message) -> bool:
        """Station.tla:189."""
        return (
            e.to == m.src
            and e.session == m.session
            and (m.of[1] != 0)
            and (m.of == (e.type, e.seq))
        )

    def within_rounds(self, k: int) -> bool:
        """Station.tla:194."""
        return k <= self.max_rounds

    def may_close(self, st: State) -> bool:
        """Station.tla:195."""
        return bool(st.recorded)

    def newer_than_joined(self, st: State, s: Session) -> bool:
        """Station.tla:196."""
        return not any(j[0] == s[0] and j[1] >= s[1] for j in st.joined)

    def quarantined(self, st: State) -> bool:
        """Station.tla:198."""
        return st.quarantine

    def may_request(self, st: State) -> bool:
        """Station.tla:199."""
        return not st.quarantine

    def next_target(self, st: State, p: int) -> bool:
        """Station.tla:200."""
        return p == st.target

    def marked(self, st: State, marks: frozenset[Session]) -> bool:
        """Station.tla:201."""
        return st.session in marks

    def next_proposal(self, k: int) -> int:
        """Station.tla:202."""
        return k + 1

    def round_left(self, st: State) -> bool:
        """Station.tla:203."""
        return st.proposal < self.max_rounds

    def ack_copy(self, me: int, m: Message) -> frozenset[Message]:
        """Station.tla:204."""
        return frozenset({self.ack(me, m)})

    @cached_property
    def reserve(self) -> int:
        """Station.tla:208."""
        return 1 + (
            self.max_rounds if self.max_rounds > self.max_participants else self.max_participants
        )

    def room(self, st: State) -> bool:
        """Station.tla:210."""
        return len(st.outbox) + self.reserve <= self.outbox_limit

    def room_to_record(self, st: State) -> bool:
        """Station.tla:211."""
        return len(st.recorded | st.withdrawn) < self.max_participants

    def room_to_remember(self, st: State, p: int) -> bool:
        """Station.tla:213."""
        return any(j[0] == p for j in st.joined) or len(st.joined) < self.memory_limit

    def in_(self, st: State, s: Session) -> bool:
        """Station.tla:217."""
        return self.bound(st) and self.same_session(st.session, s)

    def on_request(self, me: int, st: State) -> Effect:
        """Station.tla:222."""
        if self.bound(st):
            return self.refuse(st, "ADV-1")
        if not self.may_request(st):
            return self.refuse(st, "ACT-6")
        if st.backoff:
            return self.refuse(st, "END-7")
        if not self.room(st):
            return self.refuse(st, "MEM-1")
        s = (me, st.number + 1)
        return self.effect(
            st._replace(phase="ADVERTISING", role="prescriber", session=s, number=st.number + 1),
            frozenset({self.advertisement(me, s)}),
            self.nothing,
            "ADV-1",
        )

    def on_resend_advertisement(self, me: int, st: State) -> Effect:
        """Station.tla:232."""
        return self.effect(
            st, frozenset({self.advertisement(me, st.session)}), self.nothing, "ADV-2"
        )

    def on_advertisement(self, me: int, st: State, m: Message, concerned: bool) -> Effect:
        """Station.tla:235."""
        if self.bound(st):
            return self.ignore(st, "ADV-4")
        if self.quarantined(st):
            return self.ignore(st, "END-8")
        if not self.newer_than_joined(st, m.session):
            return self.ignore(st, "ADV-8")
        if not concerned:
            return self.ignore(st, "ADV-3")
        if not (self.room(st) and self.room_to_remember(st, m.src)):
            return self.ignore(st, "MEM-1")
        i = self.intention(me, m.session)
        j = st._replace(
            phase="INTENDING",
            role="receiver",
            session=m.session,
            joined=frozenset({x for x in st.joined if x[0] != m.src}) | frozenset({m.session}),
        )
        return self.effect(self.post(j, frozenset({i})), frozenset({i}), self.nothing, "ADV-3")

    def answer_closed(self, me: int, st: State, m: Message, rule: str) -> Effect:
        """Station.tla:250."""
        mine = frozenset(
            {
                e
                for e in st.outbox
                if e.to == m.src and e.session == m.session and (e.type in {"Fin", "Cancel"})
            }
        )
        return self.effect(
            st,
            frozenset({self.copy(me, e) for e in mine})
            if bool(mine)
            else frozenset({self.closed(me, m)}),
            self.nothing,
            rule,
        )

    def on_intention(self, me: int, st: State, m: Message) -> Effect:
        """Station.tla:256."""
        if not self.in_(st, m.session):
            return self.answer_closed(me, st, m, "ADV-5")
        if st.phase == "ADVERTISING":
            p = m.src
            if p in st.recorded:
                return self.answer(st, self.ack(me, m), "ADV-5")
            if p in st.withdrawn:
                return self.answer_closed(me, st, m, "ADV-5")
            if not self.room_to_record(st):
                return self.ignore(st, "MEM-1")
            return self.answer(
                st._replace(recorded=st.recorded | frozenset({p})), self.ack(me, m), "ADV-5"
            )
        p = m.src
        if p in st.recorded | frozenset({st.target}):
            return self.answer(st, self.ack(me, m), "ADV-5")
        return self.answer_closed(me, st, m, "ADV-5")

    def on_hold(self, me: int, st: State) -> Effect:
        """Station.tla:268."""
        return self.effect(self.leave(st), EMPTY, ("fallback", "timeout"), "ADV-7")

    def on_forget(self, st: State, p: int) -> Effect:
        """Station.tla:271."""
        return self.ignore(
            st._replace(joined=frozenset({j for j in st.joined if j[0] != p})), "ADV-8"
        )

    def no_participants(self, st: State, out: frozenset[Message]) -> Effect:
        """Station.tla:277."""
        return self.effect(
            self.leave(st)._replace(backoff=True), out, ("no_participants",), "PRE-1"
        )

    def on_advertise_end(self, me: int, st: State) -> Effect:
        """Station.tla:281."""
        if not st.recorded:
            return self.no_participants(st, EMPTY)
        return self.effect(
            st._replace(phase="CHOOSING", withdrawn=EMPTY), EMPTY, ("choose",), "PRE-1"
        )

    def on_close(self, me: int, st: State, c: Command) -> Effect:
        """Station.tla:287."""
        if st.phase != "ADVERTISING":
            return self.refuse(st, "CMD-1")
        if c.session != st.session:
            return self.refuse(st, "PRE-5")
        if not self.may_close(st):
            return self.refuse(st, "ADV-9")
        return self.on_advertise_end(me, st)._replace(rule="ADV-9")

    def prescribe(self, me: int, st: State, to: int, k: int, rule: str) -> Effect:
        """Station.tla:294."""
        ms = frozenset({self.prescription(me, to, st.session, k)}) | self.cancels(
            me, st, st.recorded - frozenset({to}), "not_selected"
        )
        return self.effect(
            self.post(
                st._replace(
                    phase="PRESCRIBING", target=to, proposal=k, deciding=False, recorded=EMPTY
                ),
                ms,
            ),
            ms,
            self.nothing,
            rule,
        )

    def on_prescribe(self, me: int, st: State, c: Command) -> Effect:
        """Station.tla:302."""
        if not (st.phase == "CHOOSING" or st.deciding):
            return self.refuse(st, "CMD-1")
        if c.session != st.session or c.proposal != self.next_proposal(st.proposal):
            return self.refuse(st, "PRE-5")
        if st.phase == "CHOOSING":
            if c.target in st.recorded:
                return self.prescribe(me, st, c.target, 1, "PRE-2")
            return self.refuse(st, "PRE-2")
        if self.next_target(st, c.target):
            return self.prescribe(me, st, c.target, c.proposal, "NEG-7")
        return self.refuse(st, "NEG-7")

    def on_proceed(self, me: int, st: State, c: Command) -> Effect:
        """Station.tla:313."""
        if st.phase != "CHOOSING":
            return self.refuse(st, "CMD-1")
        if c.session != st.session:
            return self.refuse(st, "PRE-5")
        return self.leave_with(
            st, self.cancels(me, st, st.recorded, "not_needed"), self.nothing, "PRE-3"
        )

    def on_foreign_prescription(self, me: int, st: State, m: Message) -> Effect:
        """Station.tla:322."""
        if self.bound(st):
            return self.answer(st, self.refusal_answer(me, m, "busy"), "NEG-4")
        return self.answer(st, self.refusal_answer(me, m, "unknown_session"), "NEG-5")

    def on_prescription(self, me: int, st: State, m: Message) -> Effect:
        """Station.tla:326."""
        if not self.in_(st, m.session):
            return self.on_foreign_prescription(me, st, m)
        if self.older_or_same(m.proposal, st.proposal):
            return self.effect(st, self.ack_copy(me, m), self.nothing, "NEG-1")
        if st.phase in {"INTENDING", "WAITING"}:
            return self.effect(
                st._replace(
                    phase="NEGOTIATING",
                    proposal=m.proposal,
                    outbox=frozenset({e for e in st.outbox if e.type != "Intention"}),
                ),
                frozenset({self.ack(me, m)}),
                ("verify",),
                "NEG-1",
            )
        return self.discard(st, "END-5")

    def on_accept(self, me: int, st: State, c: Command) -> Effect:
        """Station.tla:336."""
        if not (st.phase == "NEGOTIATING" and st.role == "receiver"):
            return self.refuse(st, "CMD-1")
        if c.session != st.session or c.proposal != st.proposal:
            return self.refuse(st, "PRE-5")
        m = self.acceptance(me, st.session, st.proposal)
        return self.effect(
            self.post(st._replace(phase="ACTUATING"), frozenset({m})),
            frozenset({m}),
            self.nothing,
            "NEG-2",
        )

    def refuse_proposal(self, me: int, st: State, why: str, told: tuple[str]) -> Effect:
        """Station.tla:345."""
        m = self.refusal(me, st.session, st.proposal, why)
        return self.effect(
            self.post(st._replace(phase="WAITING"), frozenset({m})), frozenset({m}), told, "NEG-3"
        )

    def on_refuse(self, me: int, st: State, c: Command) -> Effect:
        """Station.tla:349."""
        if not (st.phase == "NEGOTIATING" and st.role == "receiver"):
            return self.refuse(st, "CMD-1")
        if c.session != st.session or c.proposal != st.proposal:
            return self.refuse(st, "PRE-5")
        return self.refuse_proposal(me, st, "unsafe", self.nothing)

    def awaits_answer(self, st: State) -> bool:
        """Station.tla:357."""
        return st.phase == "PRESCRIBING" or (st.phase == "NEGOTIATING" and (not st.deciding))

    def ack_if_reliable(self, me: int, st: State, m: Message) -> Effect:
        """Station.tla:362."""
        return self.effect(st, self.ack_copy(me, m) if m.seq != 0 else EMPTY, self.nothing, "NEG-6")

    def on_acceptance(self, me: int, st: State, m: Message) -> Effect:
        """Station.tla:365."""
        if not self.in_(st, m.session):
            if m.accepted:
                return self.answer_closed(me, st, m, "NEG-6")
            return self.ack_if_reliable(me, st, m)
        if not self.of_peer(st, m.src) or m.proposal > st.proposal:
            return self.discard(st, "END-5")
        if not (self.awaits_answer(st) and self.same_proposal(m.proposal, st.proposal)):
            return self.ack_if_reliable(me, st, m)
        if m.accepted:
            acks = frozenset({self.ack(me, m)}) if m.seq != 0 else EMPTY
            done = st._replace(outbox=frozenset({e for e in st.outbox if e.type != "Prescription"}))
            return self.effect(done._replace(phase="ACTUATING"), acks, ("accepted",), "NEG-6")
        if m.reason not in {"busy", "unknown_session"} and self.round_left(st):
            acks = frozenset({self.ack(me, m)}) if m.seq != 0 else EMPTY
            done = st._replace(outbox=frozenset({e for e in st.outbox if e.type != "Prescription"}))
            return self.effect(
                done._replace(phase="NEGOTIATING", deciding=True), acks, ("propose",), "NEG-7"
            )
        acks = frozenset({self.ack(me, m)}) if m.seq != 0 else EMPTY
        done = st._replace(outbox=frozenset({e for e in st.outbox if e.type != "Prescription"}))
        r = self.cancel_peer(me, done, "no_agreement", "NEG-7")
        return r._replace(out=r.out | acks)

    def on_cam(self, me: int, st: State, i: Cam) -> Effect:
        """Station.tla:390."""
        if (
            st.phase == "ACTUATING"
            and self.of_peer(st, i.src)
            and self.marked(st, i.marks)
            and (i.newer or not st.heard)
        ):
            return self.ignore(st._replace(heard=True), "ACT-5")._replace(
                again=frozenset({self.timer("cam")})
            )
        return self.ignore(st, "ACT-5")

    def on_cam_loss(self, me: int, st: State) -> Effect:
        """Station.tla:397."""
        return self.cancel_peer(me, st, "cam_loss", "ACT-2")

    def on_complete(self, me: int, st: State, c: Command) -> Effect:
        """Station.tla:399."""
        if not (st.phase == "ACTUATING" and st.role == "prescriber"):
            return self.refuse(st, "CMD-1")
        if c.session != st.session:
            return self.refuse(st, "PRE-5")
        return self.leave_with(
            st, frozenset({self.fin(me, st.target, st.session)}), self.nothing, "ACT-3"
        )

    def on_fin(self, me: int, st: State, m: Message) -> Effect:
        """Station.tla:405."""
        if self.in_(st, m.session) and st.role == "receiver" and self.of_peer(st, m.src):
            return self.effect(self.leave(st), frozenset({self.ack(me, m)}), ("finished",), "ACT-3")
        return self.effect(st, self.ack_copy(me, m), self.nothing, "END-3")

    def on_abort(self, me: int, st: State, c: Command) -> Effect:
        """Station.tla:413."""
        if not self.bound(st):
            return self.refuse(st, "CMD-1")
        if c.session != st.session:
            return self.refuse(st, "PRE-5")
        return self.leave_with(
            st, self.cancels(me, st, self.others(st), "abort"), self.nothing, "END-1"
        )

    def on_cancel(self, me: int, st: State, m: Message) -> Effect:
        """Station.tla:418."""
        if not self.in_(st, m.session):
            return self.effect(
                st, self.ack_copy(me, m) if m.seq != 0 else EMPTY, self.nothing, "END-3"
            )
        if st.phase == "ADVERTISING":
            if m.src in st.withdrawn or (
                m.src not in st.recorded and (not self.room_to_record(st))
            ):
                acks = frozenset({self.ack(me, m)}) if m.seq != 0 else EMPTY
                return self.effect(st, acks, self.nothing, "END-3")
            acks = frozenset({self.ack(me, m)}) if m.seq != 0 else EMPTY
            return self.effect(
                st._replace(
                    recorded=st.recorded - frozenset({m.src}),
                    withdrawn=st.withdrawn | frozenset({m.src}),
                ),
                acks,
                self.nothing,
                "END-2",
            )
        if st.phase == "CHOOSING" and m.src in st.recorded:
            if st.recorded == frozenset({m.src}):
                acks = frozenset({self.ack(me, m)}) if m.seq != 0 else EMPTY
                return self.no_participants(st, acks)
            acks = frozenset({self.ack(me, m)}) if m.seq != 0 else EMPTY
            return self.effect(
                st._replace(recorded=st.recorded - frozenset({m.src})), acks, self.nothing, "END-2"
            )
        if st.phase != "CHOOSING" and self.of_peer(st, m.src):
            acks = frozenset({self.ack(me, m)}) if m.seq != 0 else EMPTY
            return self.effect(self.leave(st), acks, ("fallback", m.reason), "END-2")
        acks = frozenset({self.ack(me, m)}) if m.seq != 0 else EMPTY
        return self.effect(st, acks, self.nothing, "END-3")

    def on_ack(self, me: int, st: State, m: Message) -> Effect:
        """Station.tla:435."""
        acked = frozenset({e for e in st.outbox if self.ack_matches(e, m)})
        if not acked:
            return self.ignore(st, "END-6")
        types = frozenset({e.type for e in acked})
        if "Intention" in types:
            rest = st._replace(outbox=st.outbox - acked)
            return self.ignore(rest._replace(phase="WAITING"), "ADV-6")
        if "Prescription" in types:
            rest = st._replace(outbox=st.outbox - acked)
            return self.ignore(rest._replace(phase="NEGOTIATING"), "PRE-4")
        if "Acceptance" in types:
            rest = st._replace(outbox=st.outbox - acked)
            return self.ignore(rest, "NEG-9")
        rest = st._replace(outbox=st.outbox - acked)
        return self.ignore(rest, "END-6")

    def on_restart(self, me: int, st: State) -> Effect:
        """Station.tla:448."""
        return self.ignore(
            self.initial._replace(number=st.number, quarantine=True), "END-8"
        )._replace(again=frozenset({self.timer("quarantine")}))

    def breaks_protocol(self, me: int, m: Message) -> bool:
        """Station.tla:453."""
        return (
            m.src == me
            or (m.dst == self.broadcast) != (m.type == "Advertisement")
            or (m.type in {"Advertisement", "Prescription"} and m.src != m.session[0])
            or (m.type == "Prescription" and (not self.within_rounds(m.proposal)))
            or (m.type in {"Intention", "Acceptance"} and m.session[0] != me)
            or (m.type == "Cancel" and m.reason == "closed" and (m.src != m.session[0]))
        )

    def on_message(self, me: int, st: State, m: Message, concerned: bool) -> Effect:
        """Station.tla:461."""
        if m.dst not in {me, self.broadcast}:
            return self.ignore(st, "MSG-1")
        if self.breaks_protocol(me, m):
            return self.discard(st, "END-5")
        if m.type == "Advertisement":
            return self.on_advertisement(me, st, m, concerned)
        if m.type == "Intention":
            return self.on_intention(me, st, m)
        if m.type == "Prescription":
            return self.on_prescription(me, st, m)
        if m.type == "Acceptance":
            return self.on_acceptance(me, st, m)
        if m.type == "Fin":
            return self.on_fin(me, st, m)
        if m.type == "Cancel":
            return self.on_cancel(me, st, m)
        if m.type == "Ack":
            return self.on_ack(me, st, m)
        raise NoArm("Station.tla:464")

    def on_command(self, me: int, st: State, c: Command) -> Effect:
        """Station.tla:472."""
        if c.name == "request":
            return self.on_request(me, st)
        if c.name == "close":
            return self.on_close(me, st, c)
        if c.name == "prescribe":
            return self.on_prescribe(me, st, c)
        if c.name == "proceed":
            return self.on_proceed(me, st, c)
        if c.name == "accept":
            return self.on_accept(me, st, c)
        if c.name == "refuse":
            return self.on_refuse(me, st, c)
        if c.name == "complete":
            return self.on_complete(me, st, c)
        if c.name == "abort":
            return self.on_abort(me, st, c)
        raise NoArm("Station.tla:473")

    def on_decide(self, me: int, st: State) -> Effect:
        """Station.tla:485."""
        if st.role == "receiver":
            return self.refuse_proposal(me, st, "undecided", ("undecided",))
        return self.leave_with(
            st, self.cancels(me, st, self.others(st), "abort"), ("fallback", "abort"), "PRE-5"
        )

    def on_resend(self, me: int, st: State, e: Entry) -> Effect:
        """Station.tla:491."""
        if e.type == "Advertisement":
            return self.on_resend_advertisement(me, st)
        return self.effect(st, frozenset({self.copy(me, e)}), self.nothing, "REL-1")

    def give_up_entry(self, me: int, st: State, e: Entry) -> Effect:
        """Station.tla:495."""
        if e.type == "Intention":
            return self.ignore(self.drop(st, e)._replace(phase="WAITING"), "ADV-6")
        if e.type == "Prescription":
            return self.cancel_peer(me, st, "timeout", "PRE-4")
        if e.type == "Acceptance":
            return self.ignore(self.drop(st, e), "NEG-9")
        return self.ignore(self.drop(st, e), "REL-1")

    def on_give_up(self, me: int, st: State, e: Entry) -> Effect:
        """Station.tla:502."""
        return self.give_up_entry(me, st, e)

    def on_expiry(self, me: int, st: State, t: Timer) -> Effect:
        """Station.tla:504."""
        if t[0] == "advertise":
            return self.on_advertise_end(me, st)
        if t[0] == "resend":
            return self.on_resend(me, st, t[1])
        if t[0] == "giveup":
            return self.on_give_up(me, st, t[1])
        if t[0] == "decide":
            return self.on_decide(me, st)
        if t[0] == "hold":
            return self.on_hold(me, st)
        if t[0] == "answer":
            return self.cancel_peer(me, st, "timeout", "NEG-8")
        if t[0] == "cam":
            return self.on_cam_loss(me, st)
        if t[0] == "lease":
            return self.cancel_peer(me, st, "lease_expired", "ACT-4")
        if t[0] == "quarantine":
            return self.ignore(st._replace(quarantine=False), "END-8")
        if t[0] == "backoff":
            return self.ignore(st._replace(backoff=False), "END-7")
        if t[0] == "forget":
            return self.on_forget(st, t[1])
        raise NoArm("Station.tla:505")

    def decide(self, me: int, st: State, i: Input) -> Effect:
        """Station.tla:526."""
        if i.kind == "receive":
            return self.on_message(me, st, i.message, i.concerned)
        if i.kind == "cam":
            return self.on_cam(me, st, i)
        if i.kind == "command":
            return self.on_command(me, st, i)
        if i.kind == "expire":
            return self.on_expiry(me, st, i.timer)
        if i.kind == "restart":
            return self.on_restart(me, st)
        raise NoArm("Station.tla:527")

    def expired(self, i: Input) -> frozenset[Timer]:
        """Station.tla:533."""
        if i.kind == "expire":
            return frozenset({i.timer})
        return EMPTY

    def step(self, me: int, st: State, i: Input) -> Outcome:
        """Station.tla:535."""
        r = self.decide(me, st, i)
        before = self.armed(me, st)
        after = self.armed(me, r.st)
        return Outcome(
            st=r.st,
            out=r.out,
            told=r.told,
            rule=r.rule,
            arm=frozenset({t for t in after if t not in before or t in self.expired(i) | r.again}),
            stop=before - after - self.expired(i),
        )

    def marks(self, st: State) -> frozenset[Session]:
        """Station.tla:544."""
        return (frozenset({st.session}) if self.bound(st) else EMPTY) | frozenset(
            {e.session for e in (x for x in st.outbox if x.type == "Fin")}
        )

    def station_type_inv(self, me: int, st: State) -> bool:
        """Station.tla:557."""
        return (
            st.phase in self.phases
            and st.role in self.roles
            and ((st.role == "none") == (st.phase == "STANDALONE"))
            and ((st.session == self.no_session) == (st.phase == "STANDALONE"))
            and (not st.role == "prescriber" or st.session == (me, st.number))
            and (not st.role == "receiver" or (st.session in st.joined and st.session[0] != me))
            and (not st.recorded & st.withdrawn)
            and (not bool(st.recorded) or st.phase in {"ADVERTISING", "CHOOSING"})
            and (not st.phase == "CHOOSING" or bool(st.recorded))
            and (not bool(st.withdrawn) or st.phase == "ADVERTISING")
            and (
                (st.target != self.nobody)
                == (st.role == "prescriber" and st.phase not in {"ADVERTISING", "CHOOSING"})
            )
            and (st.proposal in range(0, self.max_rounds + 1))
            and (
                not not self.bound(st)
                or st
                == self.initial._replace(
                    number=st.number,
                    joined=st.joined,
                    outbox=frozenset({e for e in st.outbox if e.type in {"Fin", "Cancel"}}),
                    quarantine=st.quarantine,
                    backoff=st.backoff,
                )
            )
            and (not st.deciding or (st.role == "prescriber" and st.phase == "NEGOTIATING"))
            and (not st.heard or st.phase == "ACTUATING")
            and ((st.phase == "INTENDING") == any(e.type == "Intention" for e in st.outbox))
            and ((st.phase == "PRESCRIBING") == any(e.type == "Prescription" for e in st.outbox))
            and all(e.seq != 0 for e in st.outbox)
            and (len(st.outbox) <= self.outbox_limit)
            and (not st.quarantine or st.role != "receiver")
            and (len(st.joined) <= self.memory_limit)
        )


class OpenStation(Station):
    """The operators of OpenStation.tla with these constants."""

    def __init__(
        self,
        max_rounds: int,
        max_participants: int,
        outbox_limit: int,
        memory_limit: int,
        peers: frozenset[int],
        own_sessions: frozenset[int],
        peer_sessions: frozenset[int],
        me: int = 1,
        stranger: int = 9,
    ) -> None:
        super().__init__(max_rounds, max_participants, outbox_limit, memory_limit)
        self.peers = peers
        self.own_sessions = own_sessions
        self.peer_sessions = peer_sessions
        self.me = me
        self.stranger = stranger

    @cached_property
    def rounds(self) -> frozenset[int]:
        """OpenStation.tla:28."""
        return frozenset(range(1, self.max_rounds + 1))

    @cached_property
    def beyond(self) -> int:
        """OpenStation.tla:29."""
        return self.max_rounds + 1

    @cached_property
    def own_ids(self) -> frozenset[Session]:
        """OpenStation.tla:31."""
        return frozenset({(self.me, n) for n in self.own_sessions})

    def peer_ids(self, p: int) -> frozenset[Session]:
        """OpenStation.tla:32."""
        return frozenset({(p, n) for n in self.peer_sessions})

    @cached_property
    def foreign(self) -> frozenset[Session]:
        """OpenStation.tla:33."""
        return frozenset({(self.stranger, 1)})

    @cached_property
    def sessions(self) -> frozenset[Session]:
        """OpenStation.tla:34."""
        return (
            self.own_ids
            | frozenset(chain.from_iterable(self.peer_ids(p) for p in self.peers))
            | self.foreign
        )

    def from_peer(self, p: int) -> frozenset[Message]:
        """OpenStation.tla:40."""
        return (
            frozenset({self.advertisement(p, s) for s in self.sessions})
            | frozenset({self.intention(p, s)._replace(dst=self.me) for s in self.sessions})
            | frozenset(
                {
                    self.prescription(p, self.me, s, k)
                    for s in self.peer_ids(p)
                    for k in self.rounds | frozenset({self.beyond})
                }
            )
            | frozenset(
                {self.prescription(p, self.me, s, 1) for s in self.sessions - self.peer_ids(p)}
            )
            | frozenset(
                {
                    self.acceptance(p, s, k)
                    for s in self.own_ids
                    for k in self.rounds | frozenset({self.beyond})
                }
            )
            | frozenset(
                {self.refusal(p, s, k, "as_sent") for s in self.own_ids for k in self.rounds}
            )
            | frozenset(
                {
                    self.refusal(p, s, k, why)._replace(seq=0)
                    for s in self.own_ids
                    for k in self.rounds
                    for why in ("busy", "unknown_session")
                }
            )
            | frozenset(
                {
                    self.acceptance(p, s, 1)._replace(dst=self.me)
                    for s in self.sessions - self.own_ids
                }
            )
            | frozenset({self.fin(p, self.me, s) for s in self.sessions})
            | frozenset({self.cancel(p, self.me, s, "as_sent") for s in self.sessions})
            | frozenset(
                {self.cancel(p, self.me, s, "closed")._replace(seq=0) for s in self.sessions}
            )
        )

    def acks(self, p: int) -> frozenset[Message]:
        """OpenStation.tla:55."""
        return frozenset(
            {
                self.message("Ack", p, self.me, s, 0)._replace(of=of)
                for s in self.sessions
                for of in frozenset(
                    {
                        ("Advertisement", 1),
                        ("Intention", 1),
                        ("Fin", 1),
                        ("Cancel", 1),
                        ("Cancel", 0),
                        ("Acceptance", 0),
                        ("Intention", 2),
                        ("Fin", 2),
                        ("Cancel", 2),
                    }
                )
                | frozenset(product(frozenset({"Prescription", "Acceptance"}), self.rounds))
            }
        )

    def one_of_each(self, src: int, dst: int, s: Session) -> frozenset[Message]:
        """OpenStation.tla:64."""
        return frozenset(
            {
                m._replace(dst=dst)
                for m in (
                    self.advertisement(src, s),
                    self.intention(src, s),
                    self.prescription(src, self.me, s, 1),
                    self.acceptance(src, s, 1),
                    self.fin(src, self.me, s),
                    self.cancel(src, self.me, s, "as_sent"),
                    self.message("Ack", src, self.me, s, 0)._replace(of=("Cancel", 1)),
                )
            }
        )

    def improper(self, p: int) -> frozenset[Message]:
        """OpenStation.tla:71."""
        return (
            frozenset(
                chain.from_iterable(
                    self.one_of_each(self.me, self.me, s) for s in ((self.me, 1), (p, 1))
                )
            )
            | frozenset({self.advertisement(self.me, (self.me, 1))})
            | frozenset(
                chain.from_iterable(
                    frozenset(
                        {
                            m
                            for m in self.one_of_each(p, self.broadcast, s)
                            if m.type != "Advertisement"
                        }
                    )
                    for s in ((self.me, 1), (p, 1))
                )
            )
            | frozenset({self.advertisement(p, (p, 1))._replace(dst=self.me)})
            | frozenset(
                chain.from_iterable(
                    self.one_of_each(p, self.stranger, s) for s in ((self.me, 1), (p, 1))
                )
            )
        )

    def heard(self, ms: frozenset[Message], concerned: bool) -> frozenset[Receive]:
        """OpenStation.tla:80."""
        return frozenset({Receive(kind="receive", message=m, concerned=concerned) for m in ms})

    def cams(self, p: int) -> frozenset[Cam]:
        """OpenStation.tla:83."""
        return frozenset(
            {
                Cam(kind="cam", src=p, marks=marks, newer=newer)
                for marks in frozenset({EMPTY})
                | frozenset({frozenset({s}) for s in self.sessions})
                | frozenset(
                    {frozenset({(self.me, 1), (p, 1)}), frozenset({(p, 1), (self.stranger, 1)})}
                )
                for newer in frozenset({False, True})
            }
        )

    def cmd(self, name: str, session: Session, proposal: int, target: int) -> Command:
        """OpenStation.tla:89."""
        return Command(kind="command", name=name, session=session, proposal=proposal, target=target)

    @cached_property
    def commands(self) -> frozenset[Command]:
        """OpenStation.tla:93."""
        return (
            frozenset({self.cmd("request", self.no_session, 0, self.nobody)})
            | frozenset(
                {
                    self.cmd("prescribe", s, k, p)
                    for s in self.sessions
                    for k in self.rounds
                    for p in self.peers
                }
            )
            | frozenset(
                {
                    self.cmd(name, s, k, self.nobody)
                    for name in ("accept", "refuse")
                    for k in self.rounds
                    for s in self.sessions
                }
            )
            | frozenset(
                {
                    self.cmd(name, s, 0, self.nobody)
                    for name in ("close", "proceed", "complete", "abort")
                    for s in self.sessions
                }
            )
        )

    @cached_property
    def my_entries(self) -> frozenset[Entry]:
        """OpenStation.tla:102."""
        return frozenset(
            {
                self.entry(m)
                for m in frozenset({self.advertisement(self.me, s) for s in self.own_ids})
                | frozenset(
                    {
                        self.prescription(self.me, p, s, k)
                        for p in self.peers
                        for s in self.own_ids
                        for k in self.rounds
                    }
                )
                | frozenset({self.fin(self.me, p, s) for p in self.peers for s in self.own_ids})
                | frozenset(
                    {
                        self.cancel(self.me, p, s, "as_sent")
                        for p in self.peers
                        for s in self.own_ids
                    }
                )
                | frozenset(
                    chain.from_iterable(
                        frozenset({self.intention(self.me, s) for s in self.peer_ids(p)})
                        | frozenset(
                            {
                                self.acceptance(self.me, s, k)
                                for s in self.peer_ids(p)
                                for k in self.rounds
                            }
                        )
                        | frozenset(
                            {
                                self.refusal(self.me, s, k, "unsafe")
                                for s in self.peer_ids(p)
                                for k in self.rounds
                            }
                        )
                        | frozenset(
                            {self.cancel(self.me, p, s, "as_sent") for s in self.peer_ids(p)}
                        )
                        for p in self.peers
                    )
                )
            }
        )

    @cached_property
    def timers(self) -> frozenset[Timer]:
        """OpenStation.tla:114."""
        return (
            frozenset(
                {
                    self.timer(n)
                    for n in (
                        "advertise",
                        "decide",
                        "hold",
                        "answer",
                        "cam",
                        "lease",
                        "quarantine",
                        "backoff",
                    )
                }
            )
            | frozenset({self.resend(e) for e in self.my_entries})
            | frozenset(
                {self.give_up(e) for e in (x for x in self.my_entries if x.type != "Advertisement")}
            )
            | frozenset({self.forget(p) for p in self.peers})
        )

    @cached_property
    def alphabet(self) -> frozenset[Input]:
        """OpenStation.tla:121."""
        return (
            self.heard(frozenset(chain.from_iterable(self.from_peer(p) for p in self.peers)), True)
            | self.heard(
                frozenset(
                    chain.from_iterable(
                        frozenset({self.advertisement(p, s) for s in self.peer_ids(p)})
                        for p in self.peers
                    )
                ),
                False,
            )
            | self.heard(frozenset(chain.from_iterable(self.acks(p) for p in self.peers)), False)
            | self.heard(frozenset(chain.from_iterable(self.improper(p) for p in self.peers)), True)
            | frozenset(chain.from_iterable(self.cams(p) for p in self.peers))
            | self.commands
            | frozenset({Expire(kind="expire", timer=t) for t in self.timers})
            | frozenset({Restart(kind="restart")})
        )

    def offered(self, x: State, i: Input) -> bool:
        """OpenStation.tla:141."""
        return (
            (not i.kind == "expire" or i.timer in self.armed(self.me, x))
            and (
                not (i.kind == "expire" and i.timer[0] == "forget")
                or all(e.session[0] != i.timer[1] for e in x.outbox)
            )
            and (
                not (i.kind == "command" and i.name == "request")
                or (self.bound(x) or x.number + 1 in self.own_sessions)
            )
        )


CONDITIONS = (
    Condition("Bound", 61, "part", 8, 'st.phase # "STANDALONE"'),
    Condition("Peer", 62, "part", 9, 'st.role = "receiver"'),
    Condition("Copy", 99, "part", 30, 'e.type \\in {"Prescription", "Acceptance"}'),
    Condition("Copy", 102, "part", 56, 'e.type = "Cancel"'),
    Condition("Copy", 103, "part", 72, 'e.type = "Acceptance"'),
    Condition("Copy", 103, "part", 81, "e.accepted"),
    Condition("LeaseRuns", 115, "part", 12, 'st.phase \\in {"PRESCRIBING", "ACTUATING"}'),
    Condition("LeaseRuns", 116, "part", 19, 'st.phase = "NEGOTIATING"'),
    Condition("LeaseRuns", 116, "part", 20, 'st.role = "prescriber"'),
    Condition("LeaseRuns", 116, "part", 33, "st.deciding"),
    Condition("If", 118, "part", 10, "condition"),
    Condition("Armed", 122, "part", 191, 'st.phase = "ADVERTISING"'),
    Condition("Armed", 124, "part", 225, 'st.phase = "CHOOSING"'),
    Condition("Armed", 125, "part", 254, 'st.phase = "NEGOTIATING"'),
    Condition("Armed", 125, "part", 278, 'st.role = "receiver"'),
    Condition("Armed", 125, "part", 279, "st.deciding"),
    Condition("Armed", 127, "part", 172, 'st.phase = "WAITING"'),
    Condition("Armed", 128, "part", 176, 'st.phase = "NEGOTIATING"'),
    Condition("Armed", 128, "part", 177, 'st.role = "prescriber"'),
    Condition("Armed", 128, "part", 210, "st.deciding"),
    Condition("Armed", 130, "part", 117, 'st.phase = "ACTUATING"'),
    Condition("Armed", 131, "part", 94, "LeaseRuns(st)"),
    Condition("Armed", 134, "part", 39, "st.quarantine"),
    Condition("Armed", 135, "part", 30, "st.backoff"),
    Condition("Armed", 136, "part", 90, "x # st.session"),
    Condition("Leave", 161, "part", 52, 'e.type \\in {"Fin", "Cancel"}'),
    Condition("BreakOff", 165, "part", 15, 'st.phase = "ACTUATING"'),
    Condition("BreakOff", 165, "part", 16, 'st.role = "receiver"'),
    Condition("Others", 178, "part", 9, 'st.phase \\in {"ADVERTISING", "CHOOSING"}'),
    Condition("SameSession", 185, "part", 9, "s = t"),
    Condition("OfPeer", 186, "part", 9, "src = Peer(st)"),
    Condition("SameProposal", 187, "part", 9, "k = l"),
    Condition("OlderOrSame", 188, "part", 9, "k <= l"),
    Condition("AckMatches", 190, "part", 14, "e.to = m.src"),
    Condition("AckMatches", 191, "part", 15, "e.session = m.session"),
    Condition("AckMatches", 192, "part", 16, "m.of[2] # 0"),
    Condition("AckMatches", 193, "part", 17, "m.of = <<e.type, e.seq>>"),
    Condition("WithinRounds", 194, "part", 8, "k <= MaxRounds"),
    Condition("MayClose", 195, "part", 8, "st.recorded # {}"),
    Condition(
        "NewerThanJoined", 197, "part", 14, "\\E j \\in st.joined : j[1] = s[1] /\\ j[2] >= s[2]"
    ),
    Condition("NewerThanJoined", 197, "part", 23, "j[1] = s[1]"),
    Condition("NewerThanJoined", 197, "part", 24, "j[2] >= s[2]"),
    Condition("Quarantined", 198, "part", 8, "st.quarantine"),
    Condition("MayRequest", 199, "part", 12, "st.quarantine"),
    Condition("NextTarget", 200, "part", 9, "p = st.target"),
    Condition("Marked", 201, "part", 9, "st.session \\in marks"),
    Condition("RoundLeft", 203, "part", 8, "st.proposal < MaxRounds"),
    Condition("Reserve", 208, "part", 14, "MaxRounds > MaxParticipants"),
    Condition("Room", 210, "part", 8, "Cardinality(st.outbox) + Reserve <= OutboxLimit"),
    Condition(
        "RoomToRecord",
        212,
        "part",
        8,
        "Cardinality(st.recorded \\cup st.withdrawn) < MaxParticipants",
    ),
    Condition("RoomToRemember", 214, "part", 14, "\\E j \\in st.joined : j[1] = p"),
    Condition("RoomToRemember", 214, "part", 24, "j[1] = p"),
    Condition("RoomToRemember", 215, "part", 15, "Cardinality(st.joined) < MemoryLimit"),
    Condition("In", 217, "part", 14, "Bound(st)"),
    Condition("In", 217, "part", 15, "SameSession(st.session, s)"),
    Condition("OnRequest", 223, "guard", 14, "Bound(st)"),
    Condition("OnRequest", 223, "rule", 56, "ADV-1"),
    Condition("OnRequest", 224, "guard", 32, "MayRequest(st)"),
    Condition("OnRequest", 224, "rule", 61, "ACT-6"),
    Condition("OnRequest", 225, "guard", 18, "st.backoff"),
    Condition("OnRequest", 225, "rule", 65, "END-7"),
    Condition("OnRequest", 226, "guard", 38, "Room(st)"),
    Condition("OnRequest", 226, "rule", 70, "MEM-1"),
    Condition("OnRequest", 230, "rule", 48, "ADV-1"),
    Condition("OnResendAdvertisement", 233, "rule", 17, "ADV-2"),
    Condition("OnAdvertisement", 236, "guard", 18, "Bound(st)"),
    Condition("OnAdvertisement", 236, "rule", 77, "ADV-4"),
    Condition("OnAdvertisement", 237, "guard", 20, "Quarantined(st)"),
    Condition("OnAdvertisement", 237, "rule", 83, "END-8"),
    Condition("OnAdvertisement", 238, "guard", 45, "NewerThanJoined(st, m.session)"),
    Condition("OnAdvertisement", 238, "rule", 89, "ADV-8"),
    Condition("OnAdvertisement", 239, "guard", 48, "concerned"),
    Condition("OnAdvertisement", 239, "rule", 93, "ADV-3"),
    Condition("OnAdvertisement", 240, "guard", 95, "Room(st)"),
    Condition("OnAdvertisement", 240, "guard", 96, "RoomToRemember(st, m.src)"),
    Condition("OnAdvertisement", 240, "rule", 99, "MEM-1"),
    Condition("OnAdvertisement", 244, "part", 200, "x[1] # m.src"),
    Condition("OnAdvertisement", 246, "rule", 67, "ADV-3"),
    Condition("AnswerClosed", 251, "part", 60, "e.to = m.src"),
    Condition("AnswerClosed", 251, "part", 61, "e.session = m.session"),
    Condition("AnswerClosed", 252, "part", 62, 'e.type \\in {"Fin", "Cancel"}'),
    Condition("AnswerClosed", 253, "guard", 38, "mine # {}"),
    Condition("OnIntention", 258, "guard", 32, "In(st, m.session)"),
    Condition("OnIntention", 258, "rule", 68, "ADV-5"),
    Condition("OnIntention", 259, "guard", 16, 'st.phase = "ADVERTISING"'),
    Condition("OnIntention", 260, "guard", 39, "p \\in st.recorded"),
    Condition("OnIntention", 260, "rule", 121, "ADV-5"),
    Condition("OnIntention", 261, "guard", 41, "p \\in st.withdrawn"),
    Condition("OnIntention", 261, "rule", 129, "ADV-5"),
    Condition("OnIntention", 262, "guard", 83, "RoomToRecord(st)"),
    Condition("OnIntention", 262, "rule", 134, "MEM-1"),
    Condition("OnIntention", 263, "rule", 88, "ADV-5"),
    Condition("OnIntention", 264, "guard", 24, "p \\in st.recorded \\cup {st.target}"),
    Condition("OnIntention", 265, "rule", 97, "ADV-5"),
    Condition("OnIntention", 266, "rule", 57, "ADV-5"),
    Condition("OnHold", 269, "rule", 17, "ADV-7"),
    Condition("OnForget", 272, "rule", 15, "ADV-8"),
    Condition("OnForget", 272, "part", 35, "j[1] # p"),
    Condition("NoParticipants", 279, "rule", 17, "PRE-1"),
    Condition("OnAdvertiseEnd", 282, "guard", 10, "st.recorded = {}"),
    Condition("OnAdvertiseEnd", 284, "rule", 23, "PRE-1"),
    Condition("OnClose", 288, "guard", 13, 'st.phase # "ADVERTISING"'),
    Condition("OnClose", 288, "rule", 44, "CMD-1"),
    Condition("OnClose", 289, "guard", 15, "c.session # st.session"),
    Condition("OnClose", 289, "rule", 51, "PRE-5"),
    Condition("OnClose", 290, "guard", 33, "MayClose(st)"),
    Condition("OnClose", 290, "rule", 56, "ADV-9"),
    Condition("OnClose", 291, "rule", 59, "ADV-9"),
    Condition("OnPrescribe", 303, "guard", 52, 'st.phase = "CHOOSING"'),
    Condition("OnPrescribe", 303, "guard", 53, "st.deciding"),
    Condition("OnPrescribe", 303, "rule", 56, "CMD-1"),
    Condition("OnPrescribe", 304, "guard", 32, "c.session # st.session"),
    Condition("OnPrescribe", 304, "guard", 33, "c.proposal # NextProposal(st.proposal)"),
    Condition("OnPrescribe", 305, "rule", 65, "PRE-5"),
    Condition("OnPrescribe", 306, "guard", 18, 'st.phase = "CHOOSING"'),
    Condition("OnPrescribe", 307, "guard", 38, "c.target \\in st.recorded"),
    Condition("OnPrescribe", 307, "rule", 118, "PRE-2"),
    Condition("OnPrescribe", 308, "rule", 74, "PRE-2"),
    Condition("OnPrescribe", 309, "guard", 21, "NextTarget(st, c.target)"),
    Condition("OnPrescribe", 310, "rule", 85, "NEG-7"),
    Condition("OnPrescribe", 311, "rule", 47, "NEG-7"),
    Condition("OnProceed", 314, "guard", 12, 'st.phase # "CHOOSING"'),
    Condition("OnProceed", 314, "rule", 41, "CMD-1"),
    Condition("OnProceed", 315, "guard", 14, "c.session # st.session"),
    Condition("OnProceed", 315, "rule", 48, "PRE-5"),
    Condition("OnProceed", 317, "rule", 33, "PRE-3"),
    Condition("OnForeignPrescription", 323, "guard", 11, "Bound(st)"),
    Condition("OnForeignPrescription", 323, "rule", 34, "NEG-4"),
    Condition("OnForeignPrescription", 324, "rule", 24, "NEG-5"),
    Condition("OnPrescription", 327, "guard", 25, "In(st, m.session)"),
    Condition("OnPrescription", 328, "guard", 15, "OlderOrSame(m.proposal, st.proposal)"),
    Condition("OnPrescription", 329, "rule", 58, "NEG-1"),
    Condition("OnPrescription", 330, "guard", 17, 'st.phase \\in {"INTENDING", "WAITING"}'),
    Condition("OnPrescription", 332, "part", 141, 'e.type # "Intention"'),
    Condition("OnPrescription", 333, "rule", 67, "NEG-1"),
    Condition("OnPrescription", 334, "rule", 37, "END-5"),
    Condition("OnAccept", 337, "guard", 45, 'st.phase = "NEGOTIATING"'),
    Condition("OnAccept", 337, "guard", 46, 'st.role = "receiver"'),
    Condition("OnAccept", 338, "rule", 49, "CMD-1"),
    Condition("OnAccept", 339, "guard", 28, "c.session # st.session"),
    Condition("OnAccept", 339, "guard", 29, "c.proposal # st.proposal"),
    Condition("OnAccept", 340, "rule", 58, "PRE-5"),
    Condition("OnAccept", 343, "rule", 40, "NEG-2"),
    Condition("RefuseProposal", 347, "rule", 30, "NEG-3"),
    Condition("OnRefuse", 350, "guard", 37, 'st.phase = "NEGOTIATING"'),
    Condition("OnRefuse", 350, "guard", 38, 'st.role = "receiver"'),
    Condition("OnRefuse", 351, "rule", 41, "CMD-1"),
    Condition("OnRefuse", 352, "guard", 25, "c.session # st.session"),
    Condition("OnRefuse", 352, "guard", 26, "c.proposal # st.proposal"),
    Condition("OnRefuse", 353, "rule", 50, "PRE-5"),
    Condition("AwaitsAnswer", 358, "part", 12, 'st.phase = "PRESCRIBING"'),
    Condition("AwaitsAnswer", 359, "part", 19, 'st.phase = "NEGOTIATING"'),
    Condition("AwaitsAnswer", 359, "part", 27, "st.deciding"),
    Condition("AckIfReliable", 363, "rule", 19, "NEG-6"),
    Condition("AckIfReliable", 363, "guard", 26, "m.seq # 0"),
    Condition("OnAcceptance", 366, "guard", 45, "In(st, m.session)"),
    Condition("OnAcceptance", 367, "guard", 46, "m.accepted"),
    Condition("OnAcceptance", 367, "rule", 170, "NEG-6"),
    Condition("OnAcceptance", 369, "guard", 51, "m.proposal > st.proposal"),
    Condition("OnAcceptance", 369, "guard", 100, "OfPeer(st, m.src)"),
    Condition("OnAcceptance", 370, "rule", 106, "END-5"),
    Condition("OnAcceptance", 371, "guard", 108, "AwaitsAnswer(st)"),
    Condition("OnAcceptance", 371, "guard", 109, "SameProposal(m.proposal, st.proposal)"),
    Condition("OnAcceptance", 373, "guard", 72, "m.seq # 0"),
    Condition("OnAcceptance", 373, "guard", 116, "m.seq # 0"),
    Condition("OnAcceptance", 373, "guard", 133, "m.seq # 0"),
    Condition("OnAcceptance", 375, "part", 339, 'e.type # "Prescription"'),
    Condition("OnAcceptance", 375, "part", 348, 'e.type # "Prescription"'),
    Condition("OnAcceptance", 375, "part", 356, 'e.type # "Prescription"'),
    Condition("OnAcceptance", 377, "guard", 25, "m.accepted"),
    Condition("OnAcceptance", 379, "rule", 126, "NEG-6"),
    Condition("OnAcceptance", 380, "guard", 64, 'm.reason \\notin {"busy", "unknown_session"}'),
    Condition("OnAcceptance", 381, "guard", 65, "RoundLeft(st)"),
    Condition("OnAcceptance", 383, "rule", 143, "NEG-7"),
    Condition("OnAcceptance", 384, "rule", 83, "NEG-7"),
    Condition("OnCam", 391, "guard", 19, 'st.phase = "ACTUATING"'),
    Condition("OnCam", 391, "guard", 20, "OfPeer(st, i.src)"),
    Condition("OnCam", 392, "guard", 21, "Marked(st, i.marks)"),
    Condition("OnCam", 392, "guard", 40, "i.newer"),
    Condition("OnCam", 392, "guard", 62, "st.heard"),
    Condition("OnCam", 393, "rule", 77, "ACT-5"),
    Condition("OnCam", 395, "rule", 26, "ACT-5"),
    Condition("OnCamLoss", 397, "rule", 17, "ACT-2"),
    Condition("OnComplete", 400, "guard", 37, 'st.phase = "ACTUATING"'),
    Condition("OnComplete", 400, "guard", 38, 'st.role = "prescriber"'),
    Condition("OnComplete", 401, "rule", 41, "CMD-1"),
    Condition("OnComplete", 402, "guard", 14, "c.session # st.session"),
    Condition("OnComplete", 402, "rule", 48, "PRE-5"),
    Condition("OnComplete", 403, "rule", 32, "ACT-3"),
    Condition("OnFin", 406, "guard", 19, "In(st, m.session)"),
    Condition("OnFin", 406, "guard", 20, 'st.role = "receiver"'),
    Condition("OnFin", 406, "guard", 21, "OfPeer(st, m.src)"),
    Condition("OnFin", 407, "rule", 44, "ACT-3"),
    Condition("OnFin", 408, "rule", 27, "END-3"),
    Condition("OnAbort", 414, "guard", 22, "Bound(st)"),
    Condition("OnAbort", 414, "rule", 40, "CMD-1"),
    Condition("OnAbort", 415, "guard", 14, "c.session # st.session"),
    Condition("OnAbort", 415, "rule", 47, "PRE-5"),
    Condition("OnAbort", 416, "rule", 32, "END-1"),
    Condition("OnCancel", 419, "guard", 63, "m.seq # 0"),
    Condition("OnCancel", 419, "guard", 91, "m.seq # 0"),
    Condition("OnCancel", 419, "guard", 112, "m.seq # 0"),
    Condition("OnCancel", 419, "guard", 127, "m.seq # 0"),
    Condition("OnCancel", 419, "guard", 168, "m.seq # 0"),
    Condition("OnCancel", 419, "guard", 201, "m.seq # 0"),
    Condition("OnCancel", 420, "guard", 36, "In(st, m.session)"),
    Condition("OnCancel", 421, "rule", 81, "END-3"),
    Condition("OnCancel", 421, "guard", 155, "m.seq # 0"),
    Condition("OnCancel", 422, "guard", 17, 'st.phase = "ADVERTISING"'),
    Condition("OnCancel", 423, "guard", 85, "m.src \\in st.withdrawn"),
    Condition("OnCancel", 423, "guard", 165, "m.src \\notin st.recorded"),
    Condition("OnCancel", 423, "guard", 266, "RoomToRecord(st)"),
    Condition("OnCancel", 424, "rule", 175, "END-3"),
    Condition("OnCancel", 427, "rule", 98, "END-2"),
    Condition("OnCancel", 428, "guard", 48, 'st.phase = "CHOOSING"'),
    Condition("OnCancel", 428, "guard", 49, "m.src \\in st.recorded"),
    Condition("OnCancel", 429, "guard", 50, "st.recorded = {m.src}"),
    Condition("OnCancel", 430, "rule", 119, "END-2"),
    Condition("OnCancel", 431, "guard", 57, 'st.phase # "CHOOSING"'),
    Condition("OnCancel", 431, "guard", 58, "OfPeer(st, m.src)"),
    Condition("OnCancel", 432, "rule", 134, "END-2"),
    Condition("OnCancel", 433, "rule", 70, "END-3"),
    Condition("OnAck", 436, "part", 115, "AckMatches(e, m)"),
    Condition("OnAck", 439, "guard", 19, "acked = {}"),
    Condition("OnAck", 439, "rule", 81, "END-6"),
    Condition("OnAck", 440, "guard", 23, '"Intention" \\in types'),
    Condition("OnAck", 441, "rule", 91, "ADV-6"),
    Condition("OnAck", 442, "guard", 26, '"Prescription" \\in types'),
    Condition("OnAck", 443, "rule", 98, "PRE-4"),
    Condition("OnAck", 444, "guard", 29, '"Acceptance" \\in types'),
    Condition("OnAck", 444, "rule", 105, "NEG-9"),
    Condition("OnAck", 445, "rule", 71, "END-6"),
    Condition("OnRestart", 449, "rule", 22, "END-8"),
    Condition("BreaksProtocol", 454, "part", 14, "m.src = me"),
    Condition(
        "BreaksProtocol", 455, "part", 15, '(m.dst = Broadcast) # (m.type = "Advertisement")'
    ),
    Condition("BreaksProtocol", 456, "part", 29, 'm.type \\in {"Advertisement", "Prescription"}'),
    Condition("BreaksProtocol", 456, "part", 30, "m.src # m.session[1]"),
    Condition("BreaksProtocol", 457, "part", 32, 'm.type = "Prescription"'),
    Condition("BreaksProtocol", 457, "part", 60, "WithinRounds(m.proposal)"),
    Condition("BreaksProtocol", 458, "part", 35, 'm.type \\in {"Intention", "Acceptance"}'),
    Condition("BreaksProtocol", 458, "part", 36, "m.session[1] # me"),
    Condition("BreaksProtocol", 459, "part", 38, 'm.type = "Cancel"'),
    Condition("BreaksProtocol", 459, "part", 39, 'm.reason = "closed"'),
    Condition("BreaksProtocol", 459, "part", 40, "m.src # m.session[1]"),
    Condition("OnMessage", 462, "guard", 20, "m.dst \\notin {me, Broadcast}"),
    Condition("OnMessage", 462, "rule", 92, "MSG-1"),
    Condition("OnMessage", 463, "guard", 22, "BreaksProtocol(me, m)"),
    Condition("OnMessage", 463, "rule", 99, "END-5"),
    Condition("OnMessage", 464, "case", 24, 'm.type = "Advertisement"'),
    Condition("OnMessage", 465, "case", 26, 'm.type = "Intention"'),
    Condition("OnMessage", 466, "case", 28, 'm.type = "Prescription"'),
    Condition("OnMessage", 467, "case", 30, 'm.type = "Acceptance"'),
    Condition("OnMessage", 468, "case", 32, 'm.type = "Fin"'),
    Condition("OnMessage", 469, "case", 34, 'm.type = "Cancel"'),
    Condition("OnMessage", 470, "case", 36, 'm.type = "Ack"'),
    Condition("OnCommand", 473, "case", 18, 'c.name = "request"'),
    Condition("OnCommand", 474, "case", 20, 'c.name = "close"'),
    Condition("OnCommand", 475, "case", 22, 'c.name = "prescribe"'),
    Condition("OnCommand", 476, "case", 24, 'c.name = "proceed"'),
    Condition("OnCommand", 477, "case", 26, 'c.name = "accept"'),
    Condition("OnCommand", 478, "case", 28, 'c.name = "refuse"'),
    Condition("OnCommand", 479, "case", 30, 'c.name = "complete"'),
    Condition("OnCommand", 480, "case", 32, 'c.name = "abort"'),
    Condition("OnDecide", 486, "guard", 10, 'st.role = "receiver"'),
    Condition("OnDecide", 489, "rule", 24, "PRE-5"),
    Condition("OnResend", 492, "guard", 11, 'e.type = "Advertisement"'),
    Condition("OnResend", 493, "rule", 26, "REL-1"),
    Condition("GiveUpEntry", 496, "case", 13, 'e.type = "Intention"'),
    Condition("GiveUpEntry", 497, "rule", 46, "ADV-6"),
    Condition("GiveUpEntry", 498, "case", 15, 'e.type = "Prescription"'),
    Condition("GiveUpEntry", 498, "rule", 53, "PRE-4"),
    Condition("GiveUpEntry", 499, "case", 17, 'e.type = "Acceptance"'),
    Condition("GiveUpEntry", 499, "rule", 58, "NEG-9"),
    Condition("GiveUpEntry", 500, "rule", 38, "REL-1"),
    Condition("OnExpiry", 505, "case", 21, 't[1] = "advertise"'),
    Condition("OnExpiry", 506, "case", 23, 't[1] = "resend"'),
    Condition("OnExpiry", 507, "case", 25, 't[1] = "giveup"'),
    Condition("OnExpiry", 508, "case", 27, 't[1] = "decide"'),
    Condition("OnExpiry", 509, "case", 29, 't[1] = "hold"'),
    Condition("OnExpiry", 510, "case", 31, 't[1] = "answer"'),
    Condition("OnExpiry", 510, "rule", 136, "NEG-8"),
    Condition("OnExpiry", 511, "case", 33, 't[1] = "cam"'),
    Condition("OnExpiry", 512, "case", 35, 't[1] = "lease"'),
    Condition("OnExpiry", 512, "rule", 150, "ACT-4"),
    Condition("OnExpiry", 513, "case", 37, 't[1] = "quarantine"'),
    Condition("OnExpiry", 513, "rule", 156, "END-8"),
    Condition("OnExpiry", 514, "case", 39, 't[1] = "backoff"'),
    Condition("OnExpiry", 514, "rule", 162, "END-7"),
    Condition("OnExpiry", 515, "case", 41, 't[1] = "forget"'),
    Condition("Decide", 527, "case", 15, 'i.kind = "receive"'),
    Condition("Decide", 528, "case", 17, 'i.kind = "cam"'),
    Condition("Decide", 529, "case", 19, 'i.kind = "command"'),
    Condition("Decide", 530, "case", 21, 'i.kind = "expire"'),
    Condition("Decide", 531, "case", 23, 'i.kind = "restart"'),
    Condition("Expired", 533, "part", 9, 'i.kind = "expire"'),
    Condition("Step", 540, "part", 109, "t \\notin before"),
    Condition("Step", 540, "part", 110, "t \\in Expired(i) \\cup r.again"),
    Condition("Marks", 544, "part", 19, "Bound(st)"),
    Condition("Marks", 545, "part", 52, 'x.type = "Fin"'),
    Condition("StationTypeInv", 558, "part", 14, "st.phase \\in Phases"),
    Condition("StationTypeInv", 558, "part", 15, "st.role \\in Roles"),
    Condition("StationTypeInv", 559, "part", 16, '(st.role = "none") = (st.phase = "STANDALONE")'),
    Condition(
        "StationTypeInv", 560, "part", 17, '(st.session = NoSession) = (st.phase = "STANDALONE")'
    ),
    Condition("StationTypeInv", 561, "part", 51, "st.session = <<me, st.number>>"),
    Condition("StationTypeInv", 561, "part", 119, 'st.role = "prescriber"'),
    Condition("StationTypeInv", 562, "part", 124, 'st.role = "receiver"'),
    Condition("StationTypeInv", 562, "part", 126, "st.session \\in st.joined"),
    Condition("StationTypeInv", 562, "part", 127, "st.session[1] # me"),
    Condition("StationTypeInv", 563, "part", 20, "st.recorded \\cap st.withdrawn = {}"),
    Condition("StationTypeInv", 564, "part", 59, 'st.phase \\in {"ADVERTISING", "CHOOSING"}'),
    Condition("StationTypeInv", 564, "part", 132, "st.recorded # {}"),
    Condition("StationTypeInv", 565, "part", 62, "st.recorded # {}"),
    Condition("StationTypeInv", 565, "part", 137, 'st.phase = "CHOOSING"'),
    Condition("StationTypeInv", 566, "part", 65, 'st.phase = "ADVERTISING"'),
    Condition("StationTypeInv", 566, "part", 141, "st.withdrawn # {}"),
    Condition(
        "StationTypeInv",
        567,
        "part",
        24,
        '(st.target # Nobody) = (/\\ st.role = "prescriber" /\\ st.phase \\notin {"ADVERTISING", "CHOOSING"})',
    ),
    Condition("StationTypeInv", 567, "part", 149, 'st.role = "prescriber"'),
    Condition("StationTypeInv", 568, "part", 150, 'st.phase \\notin {"ADVERTISING", "CHOOSING"}'),
    Condition("StationTypeInv", 569, "part", 25, "st.proposal \\in 0 .. MaxRounds"),
    Condition("StationTypeInv", 570, "part", 264, "Bound(st)"),
    Condition(
        "StationTypeInv",
        571,
        "part",
        74,
        'st = [ Initial EXCEPT !.number = st.number, !.joined = st.joined, !.outbox = {e \\in st.outbox : e.type \\in {"Fin", "Cancel"}}, !.quarantine = st.quarantine, !.backoff = st.backoff ]',
    ),
    Condition("StationTypeInv", 573, "part", 451, 'e.type \\in {"Fin", "Cancel"}'),
    Condition("StationTypeInv", 576, "part", 162, "st.deciding"),
    Condition("StationTypeInv", 576, "part", 164, 'st.role = "prescriber"'),
    Condition("StationTypeInv", 576, "part", 165, 'st.phase = "NEGOTIATING"'),
    Condition("StationTypeInv", 577, "part", 80, 'st.phase = "ACTUATING"'),
    Condition("StationTypeInv", 577, "part", 167, "st.heard"),
    Condition(
        "StationTypeInv",
        578,
        "part",
        29,
        '(st.phase = "INTENDING") = (\\E e \\in st.outbox : e.type = "Intention")',
    ),
    Condition("StationTypeInv", 578, "part", 287, 'e.type = "Intention"'),
    Condition(
        "StationTypeInv",
        579,
        "part",
        30,
        '(st.phase = "PRESCRIBING") = (\\E e \\in st.outbox : e.type = "Prescription")',
    ),
    Condition("StationTypeInv", 579, "part", 292, 'e.type = "Prescription"'),
    Condition("StationTypeInv", 580, "part", 31, "\\A e \\in st.outbox : e.seq # 0"),
    Condition("StationTypeInv", 580, "part", 182, "e.seq # 0"),
    Condition("StationTypeInv", 581, "part", 32, "Cardinality(st.outbox) <= OutboxLimit"),
    Condition("StationTypeInv", 582, "part", 94, 'st.role # "receiver"'),
    Condition("StationTypeInv", 582, "part", 189, "st.quarantine"),
    Condition("StationTypeInv", 583, "part", 34, "Cardinality(st.joined) <= MemoryLimit"),
    Condition("Improper", 75, "part", 155, 'm.type # "Advertisement"'),
    Condition("Timers", 118, "part", 97, 'x.type # "Advertisement"'),
    Condition("Offered", 142, "part", 21, "i.timer \\in Armed(Me, x)"),
    Condition("Offered", 142, "part", 29, 'i.kind = "expire"'),
    Condition("Offered", 143, "part", 51, 'i.kind = "expire"'),
    Condition("Offered", 143, "part", 52, 'i.timer[1] = "forget"'),
    Condition("Offered", 144, "part", 24, "\\A e \\in x.outbox : e.session[1] # i.timer[2]"),
    Condition("Offered", 144, "part", 54, "e.session[1] # i.timer[2]"),
    Condition("Offered", 145, "part", 57, 'i.kind = "command"'),
    Condition("Offered", 145, "part", 58, 'i.name = "request"'),
    Condition("Offered", 146, "part", 40, "Bound(x)"),
    Condition("Offered", 146, "part", 41, "x.number + 1 \\in OwnSessions"),
)


"""What is decided where: see automcm_spec.vocabulary.conditions."""
