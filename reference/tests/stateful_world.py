"""A few stations, the copies in flight between them, one clock, and checks of all properties."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from stateful_oracle import ALL, IDS, Coverage, Lockstep, Setup, broken

from automcm.core.outcome import Expiry, Heard, Restart, Row
from automcm.core.phases import WAYS
from automcm.core.rules import RULES, kind
from automcm.core.state import State, Timer, key
from automcm.core.station import Effects, Station
from automcm_spec.vocabulary.application import Abort, Accepted, Command, Verify
from automcm_spec.vocabulary.messages import (
    Acceptance,
    Ack,
    Advertisement,
    Cam,
    Cancel,
    Fin,
    Prescription,
    Reliable,
    Session,
    Trajectory,
    encode,
)
from automcm_spec.vocabulary.parameters import longest_session

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
        self.sendings = p.t_giveup // p.t_resend
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

            return row._replace(then=then)

        return {
            name: tuple(counted(name, n, row) for n, row in enumerate(rows))
            for name, rows in rules.items()
        }

    def _plan(self, advertisement: Advertisement) -> Trajectory | None:
        return trajectory(7) if self.concerned else None

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
            self._take(s, self.stations[s].receive(data, self.now))

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
            self.lockstep[s].sent_cam(cam)
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
        while self.flight and count < 20 * len(self.ids):
            self.deliver(self.flight.pop(-1 if backwards else 0))
            count += 1
        return count

    # -- what a station did

    def _take(self, s: int, effects: Sequence[Effects], *, look: bool = True) -> None:
        if not effects:
            return
        for n, effect in enumerate(effects, 1):
            before, self._before[s] = self._before[s], effect.state
            self._count(s, before, effect)
            self._history(s, before, effect)
            self._step_properties(s, before, effect)
            if self.lockstep:
                self.lockstep[s].took(before, effect, n == len(effects))
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
            if isinstance(told, Verify):
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
            if isinstance(told, Accepted):
                a = told.acceptance
                self._fail_unless(
                    "S-3",
                    a.selected == self.prescribed.get((a.session, a.proposal)),
                    lambda a=a: f"{s} was told another trajectory than prescribed: {a!r}",
                )

    def _was_received(self, s: int, m: Reliable) -> bool:
        return self.received.get((m.dst, s, m.type, m.session, m.seq)) == encode(m)

    # -- properties of the whole

    def look(self) -> None:
        """S-3, S-4, S-5, S-8, T-1, T-2 when an instant is over."""
        acting = [
            (s, x)
            for s, x in ((s, self.stations[s].state) for s in self.ids)
            if x.phase == "ACTUATING" and s not in self.down
        ]
        hazards = set()
        for s, x in acting:
            assert x.session is not None
            self._agreement(s, x, acting)
            self._exclusive(s, x, acting)
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

    def _exclusive(self, s: int, x: State, acting: list[tuple[int, State]]) -> None:
        for t, y in acting:
            if t != s and x.role == y.role == "prescriber":
                self._fail_unless(
                    "S-8",
                    x.target not in (t, y.target),
                    lambda s=s, x=x, t=t, y=y: (
                        f"{s} acts on the word of {x.target}, {t} on that of {y.target}"
                    ),
                )

    def _longest(self, s: int) -> int:
        """T-1 (docs/verification.md)."""
        x = self.state(s)
        assert x.session is not None
        return longest_session(self.p.known, x.role, self.leases.get(x.session, 0))


def trajectory(k: int) -> Trajectory:
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
    return x._replace(outbox=tuple(m for m in x.outbox if m.session == before.session))


def _of(timer: Timer, session: Session | None) -> bool:
    return timer.entry is None or timer.entry.session == session
