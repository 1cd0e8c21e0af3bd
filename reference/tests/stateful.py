"""Stations of the reference under hypothesis: whatever the radio and the drivers do, S-1 … S-7 and
T-1 … T-3 hold, and every station does what the graph of one station says.

``World`` is a few stations, the copies of messages in flight between them, one clock, and all the
checks.  ``Coordination`` is its state machine: a rule for each thing that can happen.  What a
station does is written as its log (automcm.logging) and followed by the engine of
``automcm trace explain``, so every effect of every input is held against the oracle.

    python reference/tests/stateful.py --steps 1000000 --seed 1

runs the deep profile: many machines, in two processes.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, wraps
from typing import Any, ClassVar

import hypothesis
from hypothesis import HealthCheck, Phase, settings, target
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)

import automcm.logging
from automcm.interface import (
    Abort,
    Accept,
    Command,
    Complete,
    Prescribe,
    Proceed,
    Refuse,
    Request,
)
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
    Session,
    Trajectory,
    encode,
)
from automcm.outcome import Expiry, Heard, Restart, Row
from automcm.parameters import Parameters
from automcm.phases import WAYS
from automcm.rules import RULES, kind
from automcm.state import State, Timer, key
from automcm.station import Effects, Station
from automcm_spec.rules import RULES as EVERY_RULE
from automcm_traces import engine as engines
from automcm_traces.engine import Diverges, Engine
from automcm_traces.log import RECORD, Header
from automcm_traces.reader import Log
from automcm_traces.track import CannotTell, Track

IDS = (1001, 2002, 3003, 4004)
LEASES = (2500, 700, 120)
"""Longer than t_cam_loss, shorter than it, and over before anybody can answer twice."""
PROPERTIES = ("S-1", "S-2", "S-3", "S-4", "S-5", "S-6", "S-7", "T-1", "T-2", "T-3")
ALL = frozenset({*PROPERTIES, "MEM-1", "oracle"})
UNUSED_SEQ = 900
"""Higher than any seq that a station gets to."""


@dataclass(frozen=True, slots=True)
class Setup:
    """How many stations there are, and their parameters."""

    stations: int
    parameters: Parameters


def _short(**more: int) -> Parameters:
    """Three sendings of each message; N · t_resend = 300 ms."""
    usual = {"t_timeout": 200, "t_decide": 150, "t_cam_loss": 1100}
    return Parameters(**{**usual, "backoff_min": 100, "backoff_max": 400, **more})


SETUPS = (
    Setup(3, _short(max_rounds=3)),
    Setup(4, _short(max_rounds=2)),
    Setup(3, _short(max_rounds=1, max_participants=1, outbox_limit=3, memory_limit=1)),
)
TIGHT = 2
"""The setup in which MEM-1 binds."""


# -- what a run has met


def _rows(rules: dict[str, tuple[Row, ...]]) -> set[tuple[str, int, str]]:
    return {(name, n, row.rule) for name, rows in rules.items() for n, row in enumerate(rows)}


NO_ROW = {"ACT-1", "END-4"}
"""ACT-1 is the application's; END-4 is no row but the guard of many (S-7 is its check)."""


@dataclass(slots=True)
class Coverage:
    """What the machines of a run have met."""

    steps: int = 0
    inputs: Counter[str] = field(default_factory=Counter)
    """By the rule that decided."""
    phases: Counter[tuple[str, str]] = field(default_factory=Counter)
    rows: Counter[tuple[str, int, str]] = field(default_factory=Counter)
    """Rows of the reference's tables that decided: input, place, rule."""
    ways: Counter[tuple[str, str, str, str]] = field(default_factory=Counter)
    looked: Counter[str] = field(default_factory=Counter)
    """How often a property had something to look at."""
    asked: set[tuple[str, int, int]] = field(default_factory=set)
    """Transitions of the oracle's graphs that were taken."""
    cannot_tell: Counter[str] = field(default_factory=Counter)

    def add(self, other: Coverage) -> None:
        self.steps += other.steps
        for name in ("inputs", "phases", "rows", "ways", "looked", "cannot_tell"):
            getattr(self, name).update(getattr(other, name))
        self.asked |= other.asked

    def rules_and_phases_missing(self) -> list[str]:
        """What even a short run must meet."""
        return [text for text in self.missing() if text.split()[0] in ("rule", "phase", "property")]

    def missing(self) -> list[str]:
        """Rules, phases, ways between phases and rows that were never met."""
        states = {(role, phase) for role, phase, _, _ in WAYS} | {("none", "STANDALONE")}
        states -= {("prescriber", "STANDALONE"), ("receiver", "STANDALONE")}
        out = [f"rule {r}" for r in EVERY_RULE if r not in NO_ROW and not self.inputs[r]]
        out += [f"phase {r} {p}" for r, p in sorted(states) if not self.phases[r, p]]
        out += [f"way {' '.join(way)}" for way in sorted(WAYS) if not self.ways[way]]
        out += [
            f"row {n} of {name}: {r}"
            for name, n, r in sorted(_rows(RULES))
            if not self.rows[name, n, r]
        ]
        out += [f"property {p}: nothing to look at" for p in PROPERTIES if not self.looked[p]]
        return out

    def report(self) -> str:
        """Several lines for a person."""
        one, two = (engines._oracle(n) for n in (False, True))
        met = Counter(name for name, _, _ in self.asked)
        graphs = ", ".join(
            f"{oracle.name} {met[oracle.name]} of {oracle.transitions}" for oracle in (one, two)
        )
        rarest = ", ".join(f"{r} {n}" for r, n in sorted(self.inputs.items(), key=_second)[:5])
        looked = ", ".join(f"{name} {self.looked[name]}" for name in sorted(self.looked))
        rules = len([r for r in EVERY_RULE if self.inputs[r]])
        return "\n".join(
            [
                f"{self.steps} steps, {sum(self.inputs.values())} inputs of stations",
                f"rules {rules} of {len(EVERY_RULE) - len(NO_ROW)}, rows "
                f"{len(self.rows)} of {len(_rows(RULES))}, phases {len(self.phases)} of 10, "
                f"ways between phases {len(self.ways)} of {len(WAYS)}",
                f"rarest rules: {rarest}",
                f"looked at: {looked}",
                f"transitions of the oracle: {graphs}",
                f"could not be told: {dict(self.cannot_tell) or 'nothing'}",
                "missing: " + ("; ".join(self.missing()) or "nothing"),
            ]
        )


def _second(pair: tuple[Any, int]) -> int:
    return pair[1]


# -- what can go wrong


class Broken(AssertionError):
    """A property, or the oracle's rule, that does not hold.  Each has a class of its own, so
    that hypothesis shrinks one and does not slip to another."""

    what = ""


@cache
def _kind(what: str) -> type[Broken]:
    return type(f"Broken_{what.replace('-', '_')}", (Broken,), {"what": what})


def broken(what: str, text: str) -> Broken:
    """``what`` is the id of the property or rule."""
    return _kind(what)(f"{what}: {text}")


# -- the oracle


class Lockstep:
    """The log of one station, not written but fed to the engine that judges logs."""

    def __init__(self, station: Station, coverage: Coverage) -> None:
        fields = {
            "rec": "header",
            "schema": "automcm.trace/1",
            "run": "stateful",
            "station": station.station_id,
            "implementation": {"name": "automcm", "version": "0"},
            "parameters": automcm.logging.parameters(station.parameters),
            "complete": automcm.logging.COMPLETE,
        }
        header = RECORD.validate_python(fields)
        assert isinstance(header, Header)
        self.engine = Engine(Log("memory", header, [], None, False, []))
        self._station, self._coverage = station, coverage
        self._seq = 0

    def event(self, ev: str, t_ms: int, /, **fields: object) -> int:
        """As LogWriter.event, which automcm.logging calls."""
        self._seq += 1
        observed = {name: value for name, value in fields.items() if value is not None}
        record = {"rec": "event", "seq": self._seq, "t_ms": t_ms, "ev": ev, **observed}
        event: Any = RECORD.validate_python(record)
        self.engine.feed(self._seq, event)
        return self._seq

    def took(self, effects: Effects, raw: bytes, last: bool) -> None:
        """One input and its effects.  ``last``: of this instant."""
        engine = self.engine
        txs = [f"{self._station.station_id}:{self._seq + n}" for n in range(len(effects.messages))]
        try:
            log: Any = self
            automcm.logging.write(log, effects, txs, raw=raw)
            step = engine._step
            if step is not None:
                self._compare_rule(effects, step)
            engine.finish()
        except Diverges as d:
            wanted = "; ".join(d.wanted)
            raise broken(
                f"oracle {d.rule or 'none'}", f"{d.event}; expected: {wanted} ({d.guard})"
            ) from None
        self._compare_state(effects.state, last)

    def sent_cam(self, cam: Cam, now: int) -> None:
        """ACT-5: the marks are what the oracle says."""
        try:
            self.event("send", now, tx="1:1", message=automcm.messages.to_dict(cam))
        except Diverges as d:
            raise broken(f"oracle {d.rule}", f"{d.event}; expected: {d.wanted}") from None

    def _compare_rule(self, effects: Effects, step: Any) -> None:
        if step.rule != effects.rule:
            raise broken(f"oracle {step.rule}", f"{step.what}: decided by {effects.rule}")
        answer = step.answer
        if answer.changes:
            name = "two-peers" if len(step.view.ids) > 2 else "one-peer"
            self._coverage.asked.add((name, answer.state, answer.input))

    def _compare_state(self, state: State, last: bool) -> None:
        """What the log says of the station is what the station is."""
        track, known = _known(self.engine.track), _known(state)
        for name in track:
            if track[name] != known[name]:
                raise broken(
                    "oracle state", f"{name} is {known[name]}, and by the log {track[name]}"
                )
        deadlines = sorted(self._station.timers.values())
        if last and sorted(self.engine.timers.values()) != deadlines:
            raise broken("oracle timers", f"{self._station.timers}; log: {self.engine.timers}")


def _known(of: Track | State) -> dict[str, Any]:
    """The fields of Station.tla, for comparison."""
    entries: Iterable[tuple[Any, ...]]
    if isinstance(of, Track):
        entries = ((e.type, e.to, e.session, e.message["seq"]) for e in of.outbox)
    else:
        entries = (tuple(key(m)) for m in of.outbox)
    return {
        "phase": of.phase,
        "role": of.role,
        "session": of.session,
        "recorded": set(of.recorded),
        "withdrawn": set(of.withdrawn),
        "target": of.target,
        "proposal": of.proposal,
        "deciding": of.deciding,
        "heard": of.heard_ms,
        "number": of.number,
        "joined": dict(of.joined),
        "outbox": set(entries),
        "quarantine": of.quarantine,
        "backoff": of.backoff,
    }


# -- the world


@dataclass(frozen=True, slots=True)
class Copy:
    """A copy of a message on its way to one station."""

    to: int
    data: bytes
    sent_ms: int
    what: str


Rules = dict[str, tuple[Row, ...]]


class World:
    """Stations, the radio between them, and one clock.

    A copy takes less than t_resend / 2 (docs/protocol.md, section 3): time does not pass a copy
    that old, it is lost or arrives before.
    """

    def __init__(
        self,
        setup: Setup,
        *,
        rules: Rules = RULES,
        checks: frozenset[str] = ALL,
        coverage: Coverage | None = None,
    ) -> None:
        self.p = p = setup.parameters
        self.coverage = Coverage() if coverage is None else coverage
        self.checks = checks
        self.now = 0
        self.delay = (p.t_resend - 1) // 2
        self.sendings = 1 + p.t_timeout // p.t_resend
        self.flight: list[Copy] = []
        self.past: list[Copy] = []
        """Copies that arrived and are young enough to arrive once more."""
        self.concerned = True
        self.lost = ""
        """Messages of this type are lost for the time being."""
        self.down: set[int] = set()
        self.ids = IDS[: setup.stations]
        rules = self._recorded(rules)
        self.stations = {s: Station(s, p, plan=self._plan, seed=s, rules=rules) for s in self.ids}
        self.lockstep = (
            {s: Lockstep(station, self.coverage) for s, station in self.stations.items()}
            if "oracle" in checks
            else {}
        )
        self._before = {s: station.state for s, station in self.stations.items()}
        self.rules: set[tuple[str, str, str]] = set()
        """What decided in which role and phase."""
        # History, as in System.tla and TimedSystem.tla
        self.asked: dict[int, Prescription] = {}
        """By receiver: what it has to verify."""
        self.prescribed: dict[tuple[Session, int], Trajectory] = {}
        self.leases: dict[Session, int] = {}
        """The longest lease prescribed in a session."""
        self.accepted: set[tuple[int, int, Session, int]] = set()
        self.excused: set[tuple[Session, int]] = set()
        self.received: dict[tuple[int, int, str, Session, int], bytes] = {}
        self.sends: Counter[tuple[int, Any]] = Counter()
        self.bound_since: dict[int, int] = {}
        self.hazard_since: dict[Session, int] = {}
        self.longest_hazard = 0

    def _recorded(self, rules: Rules) -> Rules:
        """The rules; each row that decides is counted."""

        def counted(name: str, n: int, row: Row) -> Row:
            met, rows = (name, n, row.rule), self.coverage.rows

            def then(me: Any, st: State, i: Any) -> Any:
                rows[met] += 1
                return row.then(me, st, i)

            return Row(row.rule, row.when, then)

        return {
            name: tuple(counted(name, n, row) for n, row in enumerate(rows))
            for name, rows in rules.items()
        }

    def _plan(self, advertisement: Advertisement) -> Trajectory | None:
        return _trajectory(7) if self.concerned else None

    def state(self, s: int) -> State:
        return self.stations[s].state

    def up(self) -> list[int]:
        return [s for s in self.ids if s not in self.down]

    def at(self, role: str, *phases: str) -> list[int]:
        """The stations at work in one of these phases."""
        states = ((s, self.stations[s].state) for s in self.ids if s not in self.down)
        return [s for s, x in states if x.role == role and x.phase in phases]

    # -- what can happen

    def deliver(self, copy: Copy) -> None:
        if copy.what != self.lost:
            self.past.append(copy)
            self.hear(copy.to, copy.data)

    def hear(self, s: int, data: bytes) -> None:
        """Bytes reach a station; one that is down hears nothing."""
        if s not in self.down:
            self._take(s, self.stations[s].receive(data, self.now), data)

    def command(self, s: int, command: Command) -> None:
        self._take(s, self.stations[s].command(command, self.now))

    def crash(self, s: int) -> None:
        """The station falls silent; what it was to do is not done."""
        st = self.state(s)
        if st.role == "receiver" and st.session is not None:
            self.excused.add((st.session, s))
        self.down.add(s)
        self.bound_since.pop(s, None)
        self.look()

    def restart(self, s: int) -> None:
        self.crash(s)
        effects = self.stations[s].restart(self.now)
        self.down.discard(s)
        self._take(s, effects)

    def send_cam(self, s: int) -> Cam:
        cam = Cam(
            src=s,
            generation_ms=self.now,
            x_mm=0,
            y_mm=0,
            heading_mrad=0,
            speed_mm_s=8333,
            marks=self.state(s).marks,
        )
        if self.lockstep:
            self.lockstep[s].sent_cam(cam, self.now)
        return cam

    def fly_cam(self, s: int) -> None:
        """A CAM to everybody else."""
        data = encode(self.send_cam(s))
        self.flight += [Copy(t, data, self.now, "CAM") for t in self.ids if t != s]

    def next_deadline(self) -> int | None:
        deadlines = (self.stations[s].next_deadline() for s in self.up())
        return min((d for d in deadlines if d is not None), default=None)

    def pass_time(self, to: int, late: bool) -> None:
        """Let time pass: due timers fire, and copies that get too old are lost, or arrive at
        the last moment (``late``)."""
        while self.now < to:
            until = to
            deadline = self.next_deadline()
            if deadline is not None:
                until = min(until, deadline)
            if late and self.flight:
                until = min(until, self.flight[0].sent_ms + self.delay)
            self.now = max(until, self.now)
            if deadline is not None and deadline <= self.now:
                for s in self.up():
                    self._take(s, self.stations[s].advance(self.now), look=False)
                self.look()
            oldest = self.now - self.delay
            if late:
                while self.flight and self.flight[0].sent_ms <= oldest:
                    self.deliver(self.flight.pop(0))
            self.flight = [copy for copy in self.flight if copy.sent_ms >= oldest]
            self.past = [copy for copy in self.past if copy.sent_ms >= oldest]
        self.look()

    def exchange(self, backwards: bool = False) -> int:
        """Everything in flight arrives, and what is answered to it; no time passes.  Backwards,
        what was sent last arrives first."""
        count = 0
        while self.flight and count < 60:
            self.deliver(self.flight.pop(-1 if backwards else 0))
            count += 1
        return count

    # -- what a station did

    def _take(
        self,
        s: int,
        effects: Sequence[Effects],
        raw: bytes = b"",
        *,
        look: bool = True,
    ) -> None:
        if not effects:
            return
        for n, effect in enumerate(effects, 1):
            before, self._before[s] = self._before[s], effect.state
            self._count(s, before, effect)
            self._history(s, before, effect)
            self._step_properties(s, before, effect)
            if self.lockstep and not self._mem_1(s, before, effect):
                try:
                    self.lockstep[s].took(effect, raw, n == len(effects))
                except CannotTell as error:
                    self.coverage.cannot_tell[str(error)[:60]] += 1
                    raise
        if look:
            self.look()

    def _count(self, s: int, before: State, effect: Effects) -> None:
        coverage, state = self.coverage, effect.state
        coverage.inputs[effect.rule] += 1
        self.rules.add((effect.rule, before.role, before.phase))
        if state is not before:
            coverage.phases[state.role, state.phase] += 1
            way = before.role if before.bound else state.role, before.phase, state.phase
            if (*way, effect.rule) in WAYS:
                coverage.ways[*way, effect.rule] += 1

    def _history(self, s: int, before: State, effect: Effects) -> None:
        i, state = effect.input, effect.state
        for m in effect.messages:
            data = encode(m)
            to = [m.dst] if m.dst else [t for t in self.ids if t != s]
            self.flight += [Copy(t, data, self.now, m.type) for t in to if t in self.stations]
            if isinstance(m, Acceptance) and m.accepted:
                self.accepted.add((s, m.dst, m.session, m.proposal))
            if isinstance(m, Prescription):
                self.prescribed.setdefault((m.session, m.proposal), m.prescribed)
                self.leases[m.session] = max(self.leases.get(m.session, 0), m.lease_ms)
        for told in effect.indications:
            if told.name == "verify" and told.prescription is not None:
                self.asked[s] = told.prescription
        excuse = (
            isinstance(i, Restart)
            or (isinstance(i, Abort) and effect.rule == "END-1")
            or (isinstance(i, Expiry) and i.timer.name == "cam")
        )
        if excuse and before.role == "receiver" and before.session is not None:
            self.excused.add((before.session, s))
        if isinstance(i, Heard) and i.message.seq and i.message.dst == s:
            m = i.message
            self.received[s, m.src, m.type, m.session, m.seq] = encode(m)
        if state.bound and state.session != before.session:
            self.bound_since[s] = self.now
        elif not state.bound:
            self.bound_since.pop(s, None)

    # -- properties of a step

    def _fail_unless(self, what: str, holds: bool, text: Callable[[], str]) -> None:
        if what not in self.checks:
            return
        self.coverage.looked[what] += 1
        if not holds:
            raise broken(what, f"{self.now} ms: {text()}")

    def _step_properties(self, s: int, before: State, effect: Effects) -> None:
        i, after = effect.input, effect.state
        if after is not before and before.bound:
            self._fail_unless(
                "S-1",
                not after.bound or after.session == before.session,
                lambda: f"{s} went from {before.session} to {after.session} by {effect.rule}",
            )
            if (before.role, before.phase) == ("receiver", "ACTUATING"):
                kept = _commitment(after) == _commitment(before)
                ended = not after.bound and _ends_commitment(before, i)
                self._fail_unless(
                    "S-2",
                    kept or ended,
                    lambda: f"commitment of {s} ended by {effect.rule}, {kind_of(effect)}",
                )
        if isinstance(i, Heard):
            if i.message.type == "Ack" and after is not before:
                gone = [m for m in before.outbox if m not in after.outbox]
                for m in gone:
                    self._fail_unless("S-6", self._was_received(s, m), lambda m=m: f"{m!r}")
            if before.bound and i.message.session != before.session:
                self._fail_unless(
                    "S-7",
                    (after is before or _own(after, before) == _own(before, before))
                    and not effect.armed
                    and not any(_of(t, before.session) for t in effect.stopped),
                    lambda: f"{s} in {before.session} was moved by {i.message!r}",
                )
        for m in effect.messages:
            if m.seq and not isinstance(m, Advertisement | Ack):
                by_timer = isinstance(i, Expiry) and i.timer.name == "resend"
                if by_timer or m not in before.outbox:
                    self.sends[s, key(m)] += 1
                    count = self.sends[s, key(m)]
                    self._fail_unless(
                        "T-3",
                        count <= self.sendings,
                        lambda m=m, count=count: f"{s} sent {m.type} seq {m.seq} {count} times",
                    )
        for told in effect.indications:
            if told.name == "accepted" and told.acceptance is not None:
                a = told.acceptance
                self._fail_unless(
                    "S-3",
                    a.selected == self.prescribed.get((a.session, a.proposal)),
                    lambda a=a: f"{s} was told another trajectory than prescribed: {a!r}",
                )

    def _was_received(self, s: int, m: Reliable) -> bool:
        return self.received.get((m.dst, s, m.type, m.session, m.seq)) == encode(m)

    def _mem_1(self, s: int, before: State, effect: Effects) -> bool:
        """MEM-1 binds nowhere in the graphs the engine asks, so it is judged here."""
        p, i, after = self.p, effect.input, effect.state
        if after is not before and "MEM-1" in self.checks:
            counted = len(after.recorded) + len(after.withdrawn)
            sizes = (len(after.outbox), counted, len(after.joined))
            limits = (p.outbox_limit, p.max_participants, p.memory_limit)
            if any(size > limit for size, limit in zip(sizes, limits, strict=True)):
                raise broken("MEM-1", f"outbox, participants, memory of {s}: {sizes} of {limits}")
        if effect.rule != "MEM-1" and not (
            effect.rule == "END-3" and before.phase == "ADVERTISING"
        ):
            return False
        room = len(before.outbox) + 1 + max(p.max_participants, p.max_rounds) <= p.outbox_limit
        full = len(before.recorded) + len(before.withdrawn) >= p.max_participants
        told = [t.name for t in effect.indications]
        if isinstance(i, Request):
            right = not room and told == ["refused"] and not effect.messages
        elif isinstance(i, Heard) and isinstance(i.message, Advertisement):
            src = i.message.src
            forgetful = src not in before.joined and len(before.joined) >= p.memory_limit
            right = (not room or forgetful) and not told and not effect.messages
        elif isinstance(i, Heard) and isinstance(i.message, Intention):
            right = full and not told and not effect.messages
        elif isinstance(i, Heard) and isinstance(i.message, Cancel):
            m = i.message
            if m.session != before.session or m.src in (*before.recorded, *before.withdrawn):
                return False
            acks = [a.of for a in effect.messages if isinstance(a, Ack) and a.dst == m.src]
            right = full and not told and acks == [MessageId(type="Cancel", seq=m.seq)]
        else:
            return False
        if not (right and after == before and not effect.armed and not effect.stopped):
            raise broken("MEM-1", f"{s} was not at a limit, or did more: {effect!r}")
        return True

    # -- properties of the whole

    def look(self) -> None:
        """S-3, S-4, S-5, T-1, T-2 when an instant is over."""
        acting = [
            (s, x)
            for s, x in ((s, self.stations[s].state) for s in self.ids)
            if x.phase == "ACTUATING" and s not in self.down
        ]
        hazards = set()
        for s, x in acting:
            assert x.session is not None
            self._agreement(s, x, acting)
            if x.role == "prescriber":
                said = (x.target, s, x.session, x.proposal) in self.accepted
                self._fail_unless(
                    "S-3", said, lambda s=s, x=x: f"{s} acts on what {x.target} never accepted"
                )
                peer = next((y for t, y in acting if t == x.target), None)
                if peer is None or _commitment(peer) != ("receiver", x.session, x.proposal):
                    hazards.add(x.session)
                    self.hazard_since.setdefault(x.session, self.now)
                self._fail_unless(
                    "S-5",
                    x.session not in hazards or (x.session, x.target) in self.excused,
                    lambda s=s, x=x: (
                        f"{s} acts in {x.session}, proposal {x.proposal}, but its target "
                        f"{x.target} is {_shown(self.state(x.target))}"
                    ),
                )
        for session in [x for x in self.hazard_since if x not in hazards]:
            del self.hazard_since[session]
        for session, since in self.hazard_since.items():
            lasts, most = self.now - since, self.delay + self.p.t_cam_loss
            self.longest_hazard = max(self.longest_hazard, lasts)
            self._fail_unless(
                "T-2",
                lasts <= most,
                lambda session=session, lasts=lasts, most=most: (
                    f"hazard in {session} for {lasts} ms, at most {most} ms"
                ),
            )
        for s, since in self.bound_since.items():
            if s not in self.down:
                self._fail_unless(
                    "T-1",
                    self.now - since <= self._longest(s),
                    lambda s=s, since=since: (
                        f"{s} has been {_shown(self.state(s))} for {self.now - since} ms, "
                        f"at most {self._longest(s)} ms"
                    ),
                )

    def _agreement(self, s: int, x: State, acting: list[tuple[int, State]]) -> None:
        if x.role != "receiver":
            return
        for t, y in acting:
            if t != s and y.session == x.session:
                self._fail_unless(
                    "S-4",
                    (y.role, y.target, y.proposal) == ("prescriber", s, x.proposal),
                    lambda s=s, x=x, t=t, y=y: f"{s} is {_shown(x)}, {t} is {_shown(y)}",
                )

    def _longest(self, s: int) -> int:
        """T-1 (docs/verification.md)."""
        p, x = self.p, self.state(s)
        assert x.session is not None
        lease = self.leases.get(x.session, 0)
        if x.role == "prescriber":
            a_round = min(lease, 2 * p.t_giveup + p.t_decide) + p.t_decide
            return p.t_advertise + p.t_decide + (p.max_rounds - 1) * a_round + lease
        rounds = p.max_rounds * (p.t_hold + p.t_decide)
        return p.t_giveup + rounds + max(lease, p.t_hold)


def _trajectory(k: int) -> Trajectory:
    return Trajectory(t0=0, points=((0, 0, 0), (1000, 1000 + k, 0)))


def _shown(x: State) -> str:
    return f"{x.role} {x.phase} in {x.session}, proposal {x.proposal}"


def kind_of(effect: Effects) -> str:
    return "bytes" if effect.input is None else kind(effect.input)


def _commitment(x: State) -> Any:
    """What a committed receiver is committed to."""
    if (x.role, x.phase) != ("receiver", "ACTUATING"):
        return None
    return x.role, x.session, x.proposal


def _ends_commitment(x: State, i: Any) -> bool:
    """S-2: EndsCommitment in System.tla."""
    match i:
        case Restart() | Abort():
            return True
        case Expiry(timer):
            return timer.name in ("cam", "lease")
        case Heard(Fin() | Cancel() as m):
            return x.session is not None and (m.src, m.session) == (x.session[0], x.session)
    return False


def _own(x: State, before: State) -> State:
    """The station without what it still sends for other sessions (S-7)."""
    return replace(x, outbox=tuple(m for m in x.outbox if m.session == before.session))


def _of(timer: Timer, session: Session | None) -> bool:
    return timer.entry is None or timer.entry.session == session


# -- what is odd, and must do nothing


def odd_messages(world: World, s: int, t: int) -> list[bytes]:
    """What station ``s`` may hear from ``t`` that breaks the protocol, is not for it, or counts
    for nothing.  None of it could come from a station that follows the rules."""
    x = world.state(s)
    u = next(q for q in world.ids if q not in (s, t))
    theirs, mine, no = (t, UNUSED_SEQ), (s, max(1, x.number)), Trajectory(t0=0, points=((0, 0, 0),))
    mine = x.session if x.role == "prescriber" and x.session else mine
    air: Any = {"src": t, "session": theirs, "seq": UNUSED_SEQ}
    of: Any = {**air, "dst": s}
    advertised: Any = {"scenario": "odd", "details": {}}
    content: Any = {"proposal": 1, "prescribed": no, "hold_ms": 0, "lease_ms": 1}
    said: Any = {"proposal": 1, "accepted": True, "selected": no}
    found: list[Message] = [
        Advertisement(**{**air, "src": s}, **advertised),
        Advertisement(**of, **advertised),
        Advertisement(**{**air, "session": (u, UNUSED_SEQ)}, **advertised),
        Intention(**of, planned=no),
        Intention(**air, planned=no),
        Prescription(**{**of, "session": (u, UNUSED_SEQ)}, **content),
        Prescription(**air, **content),
        Acceptance(**of, **said),
        Acceptance(**air, **said),
        Fin(**{**of, "src": s}),
        Fin(**air),
        Fin(**{**of, "dst": u}),
        Advertisement(**{**of, "dst": u}, **advertised),
        Intention(**{**of, "dst": u}, planned=no),
        Prescription(**{**of, "dst": u}, **content),
        Acceptance(**{**of, "dst": u}, **said),
        Fin(**of),
        Fin(**{**of, "session": mine}),
        Cancel(**air, reason="abort"),
        Cancel(**of, reason="abort"),
        Cancel(**{**of, "session": mine, "seq": 0}, reason="closed"),
        _ack(t, s, theirs, "Cancel", UNUSED_SEQ),
        Ack(**{**air, "seq": 0}, of=MessageId(type="Fin", seq=1)),
    ]
    for entry in x.outbox:
        other = next(q for q in (t, u) if q != entry.dst)
        found += [
            _ack(other, s, entry.session, entry.type, entry.seq),
            _ack(entry.dst, s, entry.session, entry.type, 0),
            _ack(entry.dst, s, entry.session, entry.type, UNUSED_SEQ),
            _ack(entry.dst, s, (u, UNUSED_SEQ), entry.type, entry.seq),
            _ack(entry.dst, s, entry.session, "Advertisement", entry.seq),
        ]
    if x.session is not None and x.target:
        other = next(q for q in (t, u) if q != x.target)
        own = {**of, "session": x.session}
        found += [
            Acceptance(**{**own, "src": other}, **said),
            Cancel(**{**own, "src": other}, reason="abort"),
        ]
        if x.proposal < world.p.max_rounds:
            newer = {**said, "proposal": x.proposal + 1}
            found.append(Acceptance(**{**own, "src": x.target}, **newer))
    if x.session is not None and x.role == "receiver":
        own = {**of, "session": x.session}
        other = next(q for q in (t, u) if q != x.session[0])
        found += [Fin(**{**own, "src": other}), Cancel(**{**own, "src": other}, reason="abort")]
        if x.phase != "ACTUATING":  # nobody acts yet who could have finished
            found.append(Fin(**{**own, "src": x.session[0]}))
        if x.phase in ("NEGOTIATING", "ACTUATING") and x.proposal < world.p.max_rounds:
            newer = {**content, "proposal": x.proposal + 1}
            found.append(Prescription(**{**own, "src": x.session[0]}, **newer))
    return [b'{"v":1', b"\xff", *(encode(message) for message in found)]


def _ack(src: int, dst: int, session: Session, type_: Any, seq: int) -> Ack:
    return Ack(src=src, dst=dst, session=session, of=MessageId(type=type_, seq=seq))


# -- the machine


def step(**strategies: Any) -> Callable[[Any], Any]:
    """A rule; what is called is kept, so that a run can be told and repeated."""

    def wrap(function: Any) -> Any:
        @wraps(function)
        def called(self: Coordination, **drawn: Any) -> None:
            self.begin(function.__name__, drawn)
            function(self, **drawn)

        return rule(**strategies)(called)

    return wrap


Call = tuple[str, dict[str, Any]]
"""A rule and what was drawn for it."""

SOME = st.integers(0, 11)
STATION = st.integers(0, 3)
FEW = st.integers(1, 4)
LATE = st.booleans()
UPTO = ("CHOOSING", "PRESCRIBING", "NEGOTIATING", "ACTUATING", "DECIDING")
"""DECIDING: about the next proposal, or ACTUATING if there is none."""
LOST = st.sampled_from(("", "Ack", "Cancel", "Acceptance", "Intention", "Prescription"))
"""Messages of this type are lost."""
NAMES = ("prescribe", "proceed", "accept", "refuse", "complete", "abort")


class Coordination(RuleBasedStateMachine):
    """Each rule is one thing that can happen, or a few that often happen together.

    A number chooses among what there is, modulo how much there is, so that it stays meaningful
    while hypothesis shrinks.
    """

    rules_: ClassVar[Rules] = RULES
    checks: ClassVar[frozenset[str]] = ALL
    coverage: ClassVar[Coverage] = Coverage()
    last: ClassVar[list[Call]] = []
    """What the machine that ran last did."""
    setups: ClassVar[tuple[int, ...]] = (0, 1, 2)

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[Call] = []
        type(self).last = self.calls
        self.world = self._world(0)

    def _world(self, setup: int) -> World:
        return World(SETUPS[setup], rules=self.rules_, checks=self.checks, coverage=self.coverage)

    def begin(self, name: str, drawn: dict[str, Any]) -> None:
        self.calls.append((name, drawn))
        self.coverage.steps += 1

    @initialize(setup=st.integers(0, 2))
    def set_up(self, setup: int) -> None:
        setup = self.setups[setup % len(self.setups)]
        self.calls.append(("set_up", {"setup": setup}))
        if setup:
            self.world = self._world(setup)

    # -- the radio

    def _pick(self, n: int) -> Copy:
        flight = self.world.flight
        return flight[n % len(flight)]

    def in_flight(self) -> bool:
        return bool(self.world.flight)

    @precondition(in_flight)
    @step(n=SOME, indifferent=st.booleans())
    def deliver(self, n: int, indifferent: bool) -> None:
        """A copy arrives; whom an Advertisement does not concern is indifferent."""
        copy = self.world.flight.pop(n % len(self.world.flight))
        self.world.concerned = not indifferent
        self.world.deliver(copy)
        self.world.concerned = True

    @precondition(in_flight)
    @step(n=SOME)
    def duplicate(self, n: int) -> None:
        """A copy arrives, and will again."""
        self.world.deliver(self._pick(n))

    def has_past(self) -> bool:
        return bool(self.world.past)

    @precondition(has_past)
    @step(n=SOME)
    def again(self, n: int) -> None:
        """What has arrived arrives once more."""
        past = self.world.past
        self.world.deliver(past.pop(-1 - n % len(past)))

    @precondition(in_flight)
    @step(n=SOME)
    def lose(self, n: int) -> None:
        self.world.flight.pop(n % len(self.world.flight))

    @precondition(in_flight)
    @step(n=SOME, s=STATION)
    def overhear(self, n: int, s: int) -> None:
        """A copy also reaches a station it is not for, or its sender as an echo."""
        ids = self.world.ids
        self.world.hear(ids[s % len(ids)], self._pick(n).data)

    @step(lost=LOST, backwards=st.booleans())
    def exchange(self, lost: str, backwards: bool) -> None:
        """Everything arrives, and so do the answers."""
        self.world.lost = lost
        self.world.exchange(backwards)
        self.world.lost = ""

    @step(s=STATION, t=STATION, what=st.integers(0, 8) | st.integers(0, 60), bound=st.booleans())
    def odd(self, s: int, t: int, what: int, bound: bool) -> None:
        """A station (one in a session, if possible) hears what must do nothing."""
        stations = (self.bound() if bound else []) or self.world.ids
        s = stations[s % len(stations)]
        others = [q for q in self.world.ids if q != s]
        messages = odd_messages(self.world, s, others[t % len(others)])
        self.world.hear(s, messages[-1 - what % len(messages)])

    # -- CAMs

    @step(s=STATION)
    def cam(self, s: int) -> None:
        up = self.world.up()
        if up:
            self.world.fly_cam(up[s % len(up)])

    def _drive(self, rounds: int, deaf: int) -> None:
        world = self.world
        for _ in range(rounds):
            for s in world.up():
                data = encode(world.send_cam(s))
                for n, t in enumerate(world.ids):
                    if t != s and n != deaf:
                        world.hear(t, data)
            world.pass_time(world.now + 400, late=False)

    @step(rounds=FEW, deaf=st.integers(-1, 3))
    def drive(self, rounds: int, deaf: int) -> None:
        """For a while CAMs arrive, but not at the deaf one, and messages nowhere."""
        self._drive(rounds, deaf)

    def acting(self) -> list[int]:
        return self.world.at("prescriber", "ACTUATING")

    @precondition(acting)
    @step(rounds=st.integers(1, 6))
    def drive_on(self, rounds: int) -> None:
        """The same while somebody acts, and nobody is deaf."""
        self._drive(rounds, -1)

    # -- time

    @step(deadlines=FEW, late=LATE)
    def advance(self, deadlines: int, late: bool) -> None:
        """To the next deadline, or a few of them."""
        for _ in range(deadlines):
            deadline = self.world.next_deadline()
            if deadline is not None:
                self.world.pass_time(deadline, late)

    @precondition(in_flight)
    @step(ms=st.sampled_from((1, 10, 25, 49)), late=LATE)
    def delay(self, ms: int, late: bool) -> None:
        self.world.pass_time(self.world.now + ms, late)

    @step(ms=st.sampled_from((200, 600, 1200, 6000)))
    def silence(self, ms: int) -> None:
        """Nothing arrives for a while."""
        self.world.pass_time(self.world.now + ms, late=False)

    # -- the applications

    @step(s=STATION)
    def request(self, s: int) -> None:
        up = self.world.up()
        if up:
            self.world.command(up[s % len(up)], Request(scenario="lane_change"))

    def choosing(self) -> list[int]:
        world = self.world
        deciding = [s for s in world.at("prescriber", "NEGOTIATING") if world.state(s).deciding]
        return world.at("prescriber", "CHOOSING") + deciding

    def verifying(self) -> list[int]:
        return self.world.at("receiver", "NEGOTIATING")

    def bound(self) -> list[int]:
        return [s for s in self.world.up() if self.world.state(s).bound]

    def _prescribe(self, s: int, to: int, lease: int) -> None:
        x = self.world.state(s)
        assert x.session is not None
        targets = sorted(x.recorded) or [x.target]
        command = Prescribe(
            session=x.session,
            proposal=x.proposal + 1,
            target=targets[to % len(targets)],
            prescribed=_trajectory(x.session[1] * 10 + x.proposal),
            hold_ms=50,
            lease_ms=lease,
        )
        self.world.command(s, command)

    @precondition(choosing)
    @step(s=STATION, to=STATION, lease=st.sampled_from(LEASES))
    def prescribe(self, s: int, to: int, lease: int) -> None:
        stations = self.choosing()
        self._prescribe(stations[s % len(stations)], to, lease)

    @precondition(choosing)
    @step(s=STATION)
    def proceed(self, s: int) -> None:
        stations = self.choosing()
        s = stations[s % len(stations)]
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, Proceed(session=session))

    def _verdict(self, s: int, refused: bool) -> None:
        m = self.world.asked[s]
        which: Any = {"session": m.session, "proposal": m.proposal}
        command = Refuse(**which) if refused else Accept(**which, selected=m.prescribed)
        self.world.command(s, command)

    @precondition(verifying)
    @step(s=STATION, refused=st.booleans())
    def verdict(self, s: int, refused: bool) -> None:
        stations = self.verifying()
        self._verdict(stations[s % len(stations)], refused)

    @precondition(acting)
    @step(s=STATION)
    def complete(self, s: int) -> None:
        stations = self.acting()
        s = stations[s % len(stations)]
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, Complete(session=session))

    @precondition(bound)
    @step(s=STATION)
    def abort(self, s: int) -> None:
        stations = self.bound()
        s = stations[s % len(stations)]
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, Abort(session=session))

    @step(s=STATION, name=st.sampled_from(NAMES), what=st.integers(0, 3))
    def untimely(self, s: int, name: str, what: int) -> None:
        """A command, whatever the phase."""
        up = self.world.up()
        if up:
            self._mistake(up[s % len(up)], name, what)

    def asked(self) -> list[tuple[str, int]]:
        """Whose command would fit its phase."""
        found = [("prescribe", s) for s in self.choosing()]
        found += [("proceed", s) for s in self.world.at("prescriber", "CHOOSING")]
        found += [(name, s) for s in self.verifying() for name in ("accept", "refuse")]
        return found + [("complete", s) for s in self.acting()]

    @precondition(asked)
    @step(n=SOME, what=st.integers(0, 3))
    def mistaken(self, n: int, what: int) -> None:
        """A command that fits the phase, but perhaps not the session, proposal or target."""
        commands = self.asked()
        name, s = commands[n % len(commands)]
        self._mistake(s, name, what)

    def _mistake(self, s: int, name: str, what: int) -> None:
        x = self.world.state(s)
        session = x.session or (s, 1)
        if what == 1:
            session = session[0], session[1] + 1
        wrong = what == 2
        prescribed = _trajectory(1)
        which: Any = {"session": session, "proposal": max(1, x.proposal + wrong)}
        command: Command
        match name:
            case "prescribe":
                targets = [q for q in self.world.ids if q not in (x.target, *x.recorded)]
                targets = sorted(targets, key=lambda q: q != s)  # itself first
                others = [q for q in self.world.ids if q != s]
                command = Prescribe(
                    session=session,
                    proposal=x.proposal + 1 + wrong,
                    target=targets[0] if what == 3 and targets else (x.target or others[0]),
                    prescribed=prescribed,
                    hold_ms=0,
                    lease_ms=LEASES[0],
                )
            case "proceed":
                command = Proceed(session=session)
            case "accept":
                m = self.world.asked.get(s)
                command = Accept(**which, selected=m.prescribed if m else prescribed)
            case "refuse":
                command = Refuse(**which)
            case "complete":
                command = Complete(session=session)
            case _:
                command = Abort(session=session)
        self.world.command(s, command)

    def _arrive(self, lost: str, slow: bool) -> None:
        """What arrives, arrives, but for messages of one type; if there is nothing, time passes.
        It also does if messages are slow."""
        world = self.world
        world.lost = lost
        deadline = world.next_deadline()
        moved = not slow and world.exchange() > 0
        if deadline is not None and not (moved or self.choosing() or self.verifying()):
            world.pass_time(deadline, late=slow)
        world.lost = ""

    def _answer(self, lease: int, refusals: int) -> None:
        """Who is asked agrees, after some refusals."""
        for s in self.choosing():
            self._prescribe(s, 0, lease)
        for s in self.verifying():
            self._verdict(s, refused=self.world.asked[s].proposal <= refusals)

    @step(rounds=st.integers(1, 8), refusals=st.integers(0, 2), lost=LOST, slow=st.booleans())
    def go_on(self, rounds: int, refusals: int, lost: str, slow: bool) -> None:
        """A while in which all goes well, but that messages of one type are lost."""
        for _ in range(rounds):
            self._arrive(lost, slow)
            self._answer(LEASES[0], refusals)

    def at_rest(self) -> list[int]:
        states = ((s, self.world.state(s)) for s in self.world.up())
        return [s for s, x in states if not x.bound and not x.backoff]

    @precondition(at_rest)
    @step(
        s=STATION,
        upto=st.sampled_from(UPTO),
        lease=st.sampled_from(LEASES),
        refusals=st.integers(0, 2),
        lost=LOST,
        slow=st.booleans(),
    )
    def session(self, s: int, upto: str, lease: int, refusals: int, lost: str, slow: bool) -> None:
        """A station opens a session, and it goes on up to a phase of its."""
        stations = self.at_rest()
        s = stations[s % len(stations)]
        self.world.command(s, Request(scenario="lane_change"))
        for _ in range(16):
            for go_on in (
                lambda: self._arrive(lost, slow),
                lambda: self._answer(lease, refusals),
            ):
                go_on()
                x = self.world.state(s)
                if x.phase in (upto, "STANDALONE"):
                    return
                if upto == "DECIDING" and (x.deciding or x.phase == "ACTUATING"):
                    return

    @precondition(at_rest)
    @step(s=STATION, times=st.integers(1, 3))
    def change_of_mind(self, s: int, times: int) -> None:
        """A station opens a session and soon aborts it; nobody hears of that."""
        stations = self.at_rest()
        s = stations[s % len(stations)]
        for _ in range(times):
            self.world.command(s, Request(scenario="lane_change"))
            self.world.exchange()
            session = self.world.state(s).session
            if session is not None:
                self.world.command(s, Abort(session=session))

    def promised(self) -> list[int]:
        return self.world.at("receiver", "INTENDING", "WAITING", "NEGOTIATING", "ACTUATING")

    @precondition(promised)
    @step(s=STATION, heard=st.booleans())
    def defect(self, s: int, heard: bool) -> None:
        """A receiver breaks off.  That arrives before anything else; or nobody hears of it, and
        it opens a session of its own."""
        stations = self.promised()
        s = stations[s % len(stations)]
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, Abort(session=session))
        if heard:
            self.world.exchange(backwards=True)
        else:
            self.world.flight = [c for c in self.world.flight if c.what != "Cancel"]
            self.world.command(s, Request(scenario="lane_change"))

    def committed(self) -> list[int]:
        return self.world.at("receiver", "ACTUATING")

    @precondition(committed)
    @step(s=STATION, restart=st.booleans())
    def let_go(self, s: int, restart: bool) -> None:
        """A committed receiver aborts, or restarts, and nobody hears of it."""
        stations = self.committed()
        s = stations[s % len(stations)]
        if restart:
            self.world.restart(s)
            return
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, Abort(session=session))
        self.world.flight = [c for c in self.world.flight if c.what != "Cancel"]

    session_again = session
    go_on_again = go_on
    mistaken_again = mistaken
    odd_again = odd
    drive_on_again = drive_on

    # -- crashes

    @step(s=STATION, what=st.sampled_from(("restart", "crash")), bound=st.booleans())
    def trouble(self, s: int, what: str, bound: bool) -> None:
        """A station falls silent; or it comes back, from a crash before or now."""
        world = self.world
        stations = (self.bound() if bound else []) or world.ids
        s = stations[s % len(stations)]
        if what == "restart":
            world.restart(s)
        elif len(world.up()) > 1 and s not in world.down:
            world.crash(s)

    def teardown(self) -> None:
        if hypothesis.currently_in_test_context():
            world = self.world
            target(len(world.rules), label="rules by role and phase")
            target(len(world.accepted), label="acceptances")
            target(max((k for _, k in world.prescribed), default=0), label="proposals")
            target(world.longest_hazard, label="hazard, ms")


def profile(examples: int, steps: int, *, steered: bool = False) -> settings:
    """``steered``: half of the machines climb towards what ``teardown`` names as targets.

    Nothing depends on the wall clock: no deadline, and ``too_slow`` is suppressed because it
    would fail on a busy computer.  Shrinking is left to ``shortened``.
    """
    phases = [Phase.generate, Phase.target] if steered else [Phase.generate]
    return settings(
        max_examples=examples,
        stateful_step_count=steps,
        phases=phases,
        deadline=None,
        database=None,
        report_multiple_bugs=False,
        suppress_health_check=[HealthCheck.too_slow],
    )


def run(machine: type[Coordination], profile: settings, seed: int) -> Coverage:
    """Run machines and return what they met.  Raises Broken; ``machine.last`` has the exchange."""
    machine.coverage = Coverage()
    hypothesis.seed(seed)(machine)
    run_state_machine_as_test(machine, settings=profile)
    return machine.coverage


def repeated(machine: type[Coordination], calls: Sequence[Call]) -> str:
    """Do the same again, without hypothesis.  Returns what broke, "" for nothing, and "?" if a
    step cannot be taken."""
    again = machine()
    try:
        for name, drawn in calls:
            getattr(again, name)(**drawn)
    except Broken as error:
        return error.what
    except (ZeroDivisionError, CannotTell, KeyError):
        return "?"
    return ""


def shortened(machine: type[Coordination], calls: Sequence[Call], what: str) -> list[Call]:
    """The exchange without the steps that are not needed for ``what`` to break.

    Hypothesis leaves some: what is drawn for one step decides how the next is read.
    """
    kept = list(calls)

    def fails(candidate: list[Call]) -> bool:
        nonlocal kept
        if candidate == kept or repeated(machine, candidate) != what:
            return False
        kept = candidate
        return True

    before: list[Call] = []
    while kept != before:
        before = kept
        for size in (8, 4, 2, 1):
            at = len(kept) - size
            while at > 0:  # the first call sets up
                fails(kept[:at] + kept[at + size :])
                at = min(at, len(kept)) - size
        for at, (name, drawn) in enumerate(kept):
            for argument, value in drawn.items():
                for simpler in SIMPLER.get(argument, (type(value)(),)):
                    now = kept[at][1]
                    if now[argument] == simpler:
                        break
                    if fails([*kept[:at], (name, {**now, argument: simpler}), *kept[at + 1 :]]):
                        break
    return kept


SIMPLER: dict[str, tuple[Any, ...]] = {
    "lease": LEASES,
    "upto": UPTO,
    "name": NAMES,
    "ms": (1, 200),
    "deadlines": (1, 2, 3),
    "rounds": tuple(range(1, 9)),
    "times": (1, 2),
    "what": tuple(range(9)),
}
"""Values to try, simplest first; elsewhere 0, False or nothing."""


def told(calls: Sequence[Call]) -> str:
    """An exchange, as a program."""
    lines = [f"m.{name}({', '.join(f'{k}={v!r}' for k, v in d.items())})" for name, d in calls]
    return "\n".join(["m = Coordination()", *lines])


# -- the deep profile


def batch(seed: int) -> tuple[int, Coverage, str]:
    """Some thousand steps.  Returns what they met, and what broke."""
    try:
        run(Coordination, profile(100, 50 + 50 * (seed % 2), steered=seed % 4 == 3), seed)
    except Broken as error:
        calls = shortened(Coordination, Coordination.last, error.what)
        return seed, Coordination.coverage, f"seed {seed}: {error}\n{told(calls)}"
    except Exception as error:
        text = f"seed {seed}: {type(error).__name__}: {error}\n{told(Coordination.last)}"
        return seed, Coordination.coverage, text
    return seed, Coordination.coverage, ""


def main() -> int:
    parser = argparse.ArgumentParser(description="The deep profile of the stateful tests.")
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1, help="the first; each batch has its own")
    parser.add_argument("--processes", type=int, default=2)
    wanted = parser.parse_args()
    total, failures, seed, began = Coverage(), 0, wanted.seed, time.monotonic()
    with multiprocessing.get_context("spawn").Pool(wanted.processes) as pool:
        for seed, coverage, broke in pool.imap(batch, itertools.count(wanted.seed)):
            total.add(coverage)
            if broke:
                failures += 1
                print(broke, flush=True)
            if sys.stderr.isatty():
                print(f"\r{total.steps} steps, seed {seed}", end="", file=sys.stderr, flush=True)
            if total.steps >= wanted.steps or failures >= 5:
                break
        pool.terminate()
    seconds = time.monotonic() - began
    print(f"seeds {wanted.seed} to {seed}, {seconds:.0f} s, {total.steps / seconds:.0f} steps/s")
    print(total.report())
    print(f"{failures} batches failed")
    return 1 if failures or total.missing() or total.cannot_tell else 0


if __name__ == "__main__":
    sys.exit(main())
