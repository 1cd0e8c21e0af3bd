"""The properties of docs/verification.md, looked at while stations do whatever they do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from stateful_oracle import IDS, Coverage, Setup, broken

from automcm.core.outcome import Expiry, Received, Restart
from automcm.core.rules import kind
from automcm.core.state import State, Timer, key
from automcm.core.station import Effects, Station
from automcm_spec.vocabulary import messages
from automcm_spec.vocabulary.application import Abort, Accepted
from automcm_spec.vocabulary.parameters import longest_session


class Properties:
    """What happened to some stations, as far as S-1 to S-8 and T-1 to T-3 need it."""

    stations: dict[int, Station]

    def __init__(self, setup: Setup, checks: frozenset[str], coverage: Coverage) -> None:
        self.p = p = setup.parameters
        self.coverage = coverage
        self.checks = checks
        self.now = 0
        self.delay = (p.t_resend - 1) // 2
        self.sendings = p.t_giveup // p.t_resend
        self.ids = IDS[: setup.stations]
        self.down: set[int] = set()
        # History, as in System.tla and TimedSystem.tla
        self.asked: dict[int, messages.Prescription] = {}
        """By receiver: the proposals that it must verify."""
        self.prescribed: dict[tuple[messages.Session, int], messages.Trajectory] = {}
        self.leases: dict[messages.Session, int] = {}
        """The longest lease prescribed in a session."""
        self.accepted: set[tuple[int, int, messages.Session, int]] = set()
        self.excused: set[tuple[messages.Session, int]] = set()
        self.received: dict[tuple[int, int, str, messages.Session, int], bytes] = {}
        self.sends: Counter[tuple[int, Any]] = Counter()
        self.bound_since: dict[int, int] = {}
        self.hazard_since: dict[messages.Session, int] = {}
        self.longest_hazard = 0

    def state(self, s: int) -> State:
        return self.stations[s].state

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
                    lambda: f"commitment of {s} ended by {effect.rule}, {_kind_of(effect)}",
                )
        if isinstance(i, Received):
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
            if m.seq and not isinstance(m, messages.Advertisement | messages.Ack):
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

    def _was_received(self, s: int, m: messages.Reliable) -> bool:
        return self.received.get((m.dst, s, m.type, m.session, m.seq)) == messages.encode(m)

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


def _shown(x: State) -> str:
    return f"{x.role} {x.phase} in {x.session}, proposal {x.proposal}"


def _kind_of(effect: Effects) -> str:
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
        case Received(messages.Fin() | messages.Cancel() as m):
            return x.session is not None and (m.src, m.session) == (x.session[0], x.session)
    return False


def _own(x: State, before: State) -> State:
    """The station without the messages that it still sends for other sessions (S-7)."""
    return x._replace(outbox=tuple(m for m in x.outbox if m.session == before.session))


def _of(timer: Timer, session: messages.Session | None) -> bool:
    return timer.entry is None or timer.entry.session == session
