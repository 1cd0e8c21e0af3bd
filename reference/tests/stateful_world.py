"""A few stations, the copies in flight between them, and one clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stateful_oracle import ALL, Coverage, Lockstep, Setup
from stateful_properties import Properties

from automcm.core.outcome import Expiry, Received, Restart, Row
from automcm.core.phases import WAYS
from automcm.core.rules import RULES
from automcm.core.state import State
from automcm.core.station import Effects, Station
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.application import Abort, Command, Verify


@dataclass(frozen=True, slots=True)
class Copy:
    """A copy of a message on its way to one station."""

    to: int
    data: bytes
    sent_ms: int
    what: str


Rules = dict[str, tuple[Row, ...]]


class World(Properties):
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
        super().__init__(setup, checks, Coverage() if coverage is None else coverage)
        p = self.p
        self.flight: list[Copy] = []
        self.past: list[Copy] = []
        """Copies that arrived and are young enough to arrive once more."""
        self.concerned = True
        self.lost = ""
        """Messages of this type are lost for the time being."""
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

    def _plan(self, advertisement: messages.Advertisement) -> messages.Trajectory | None:
        return trajectory(7) if self.concerned else None

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
        """The station falls silent and drops its pending work."""
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

    def send_cam(self, s: int) -> messages.Cam:
        cam = messages.Cam(
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
        data = messages.encode(self.send_cam(s))
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
            data = messages.encode(m)
            to = [m.dst] if m.dst else [t for t in self.ids if t != s]
            self.flight += [Copy(t, data, self.now, m.type) for t in to if t in self.stations]
            if isinstance(m, messages.Acceptance) and m.accepted:
                self.accepted.add((s, m.dst, m.session, m.proposal))
            if isinstance(m, messages.Prescription):
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
        if isinstance(i, Received) and i.message.seq and i.message.dst == s:
            m = i.message
            self.received[s, m.src, m.type, m.session, m.seq] = messages.encode(m)
        if state.bound and state.session != before.session:
            self.bound_since[s] = self.now
        elif not state.bound:
            self.bound_since.pop(s, None)


def trajectory(k: int) -> messages.Trajectory:
    return messages.Trajectory(t0=0, points=((0, 0, 0), (1000, 1000 + k, 0)))
