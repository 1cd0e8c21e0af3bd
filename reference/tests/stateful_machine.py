"""The machine of the stateful tests: what can happen to a few stations, as rules of hypothesis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, ClassVar, TypeVar

import hypothesis
from hypothesis import strategies as st
from hypothesis import target
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule
from stateful_odd import odd_messages
from stateful_oracle import ALL, IDS, LEASES, Coverage, Setup, setup
from stateful_world import Rules, World, trajectory

from automcm.core.rules import RULES
from automcm_spec.vocabulary.application import (
    Abort,
    Accept,
    Command,
    Complete,
    Prescribe,
    Proceed,
    Refuse,
    Request,
)
from automcm_spec.vocabulary.messages import encode

# -- the machine

T = TypeVar("T")


def step(**strategies: Any) -> Callable[[Any], Any]:
    """A rule; what is called is kept, so that a run can be told and repeated."""

    def wrap(function: Any) -> Any:
        @wraps(function)
        def called(self: Coordination, **drawn: Any) -> None:
            self.begin(function.__name__, drawn)
            function(self, **drawn)

        return rule(**strategies)(called)

    return wrap


def nth(of: Sequence[T], n: int) -> T:
    return of[n % len(of)]


Call = tuple[str, dict[str, Any]]
"""A rule and what was drawn for it."""

SOME = st.integers(0, 11)
STATION = st.integers(0, 3) | st.integers(0, len(IDS) - 1)
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

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[Call] = []
        type(self).last = self.calls
        self.world = self._world(setup(3, 3, 12, 20, 12))

    def _world(self, setup: Setup) -> World:
        return World(setup, rules=self.rules_, checks=self.checks, coverage=self.coverage)

    def begin(self, name: str, drawn: dict[str, Any]) -> None:
        self.calls.append((name, drawn))
        self.coverage.steps += 1

    @initialize(
        stations=st.integers(2, 4) | st.integers(2, len(IDS)),
        rounds=st.integers(1, 5),
        participants=st.sampled_from((12, 1, 2, 3, 5, 7)),
        spare=st.sampled_from((20, 0, 1, 2, 3)),
        memory=st.sampled_from((12, 1, 2, 3)),
    )
    def set_up(
        self, stations: int, rounds: int, participants: int, spare: int, memory: int
    ) -> None:
        """Any number of stations, and limits that bind or do not."""
        limits = {"stations": stations, "rounds": rounds, "participants": participants}
        limits |= {"spare": spare, "memory": memory}
        self.calls.append(("set_up", limits))
        self.world = self._world(setup(**limits))

    # -- the radio

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
        self.world.deliver(nth(self.world.flight, n))

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
        self.world.hear(nth(self.world.ids, s), nth(self.world.flight, n).data)

    @step(lost=LOST, backwards=st.booleans())
    def exchange(self, lost: str, backwards: bool) -> None:
        """Everything arrives, and so do the answers."""
        self.world.lost = lost
        self.world.exchange(backwards)
        self.world.lost = ""

    @step(s=STATION, t=STATION, what=st.integers(0, 8) | st.integers(0, 60), bound=st.booleans())
    def odd(self, s: int, t: int, what: int, bound: bool) -> None:
        """A station (one in a session, if possible) hears what must do nothing."""
        s = nth((self.bound() if bound else []) or self.world.ids, s)
        messages = odd_messages(self.world, s, nth([q for q in self.world.ids if q != s], t))
        self.world.hear(s, messages[-1 - what % len(messages)])

    # -- CAMs

    @step(s=STATION)
    def cam(self, s: int) -> None:
        up = self.world.up()
        if up:
            self.world.fly_cam(nth(up, s))

    def _drive(self, rounds: int, deaf: int) -> None:
        world = self.world
        for _ in range(rounds):
            for s in world.up():
                data = encode(world.send_cam(s))
                for n, t in enumerate(world.ids):
                    if t != s and n != deaf:
                        world.hear(t, data)
            world.pass_time(world.now + 400, late=False)

    @step(rounds=FEW, deaf=st.integers(-1, len(IDS) - 1))
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
            self.world.command(nth(up, s), Request(scenario="lane_change", details={}))

    def choosing(self) -> list[int]:
        world = self.world
        deciding = [s for s in world.at("prescriber", "NEGOTIATING") if world.state(s).deciding]
        return world.at("prescriber", "CHOOSING") + deciding

    def verifying(self) -> list[int]:
        return self.world.at("receiver", "NEGOTIATING")

    def bound(self) -> list[int]:
        return [s for s in self.world.up() if self.world.state(s).bound]

    def _say(self, s: int, command: type[Proceed | Complete | Abort]) -> None:
        """Of the session that it is in."""
        session = self.world.state(s).session
        assert session is not None
        self.world.command(s, command(session=session))

    def _prescribe(self, s: int, to: int, lease: int) -> None:
        x = self.world.state(s)
        assert x.session is not None
        targets = sorted(x.recorded) or [x.target]
        command = Prescribe(
            session=x.session,
            proposal=x.proposal + 1,
            target=nth(targets, to),
            prescribed=trajectory(x.session[1] * 10 + x.proposal),
            hold_ms=50,
            lease_ms=lease,
        )
        self.world.command(s, command)

    @precondition(choosing)
    @step(s=STATION, to=STATION, lease=st.sampled_from(LEASES))
    def prescribe(self, s: int, to: int, lease: int) -> None:
        self._prescribe(nth(self.choosing(), s), to, lease)

    @precondition(choosing)
    @step(s=STATION)
    def proceed(self, s: int) -> None:
        self._say(nth(self.choosing(), s), Proceed)

    def _verdict(self, s: int, refused: bool) -> None:
        m = self.world.asked[s]
        which: Any = {"session": m.session, "proposal": m.proposal}
        command = Refuse(**which) if refused else Accept(**which, selected=m.prescribed)
        self.world.command(s, command)

    @precondition(verifying)
    @step(s=STATION, refused=st.booleans())
    def verdict(self, s: int, refused: bool) -> None:
        self._verdict(nth(self.verifying(), s), refused)

    @precondition(acting)
    @step(s=STATION)
    def complete(self, s: int) -> None:
        self._say(nth(self.acting(), s), Complete)

    @precondition(bound)
    @step(s=STATION)
    def abort(self, s: int) -> None:
        self._say(nth(self.bound(), s), Abort)

    @step(s=STATION, name=st.sampled_from(NAMES), what=st.integers(0, 3))
    def untimely(self, s: int, name: str, what: int) -> None:
        """A command, whatever the phase."""
        up = self.world.up()
        if up:
            self._mistake(nth(up, s), name, what)

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
        name, s = nth(self.asked(), n)
        self._mistake(s, name, what)

    def _mistake(self, s: int, name: str, what: int) -> None:
        x = self.world.state(s)
        session = x.session or (s, 1)
        if what == 1:
            session = session[0], session[1] + 1
        wrong = what == 2
        prescribed = trajectory(1)
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
        self._session(nth(self.at_rest(), s), upto, lease, refusals, lost, slow)

    def _session(
        self, s: int, upto: str, lease: int, refusals: int = 0, lost: str = "", slow: bool = False
    ) -> None:
        self.world.command(s, Request(scenario="lane_change", details={}))
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
        s = nth(self.at_rest(), s)
        for _ in range(times):
            self.world.command(s, Request(scenario="lane_change", details={}))
            self.world.exchange()
            if self.world.state(s).session is not None:
                self._say(s, Abort)

    def promised(self) -> list[int]:
        return self.world.at("receiver", "INTENDING", "WAITING", "NEGOTIATING", "ACTUATING")

    @precondition(promised)
    @step(s=STATION, heard=st.booleans())
    def defect(self, s: int, heard: bool) -> None:
        """A receiver breaks off.  That arrives before anything else; or nobody hears of it, and
        it opens a session of its own."""
        s = nth(self.promised(), s)
        self._say(s, Abort)
        if heard:
            self.world.exchange(backwards=True)
        else:
            self.world.flight = [c for c in self.world.flight if c.what != "Cancel"]
            self.world.command(s, Request(scenario="lane_change", details={}))

    def committed(self) -> list[int]:
        return self.world.at("receiver", "ACTUATING")

    @step(s=STATION, restart=st.booleans(), rival=st.booleans())
    def let_go(self, s: int, restart: bool, rival: bool) -> None:
        """A committed receiver (of a new session if there is none) aborts, or restarts, and nobody
        hears of it; another station may want it then."""
        stations = self.at_rest()
        if stations and not self.committed():
            self._session(nth(stations, s), "ACTUATING", LEASES[0])
        if not self.committed():
            return
        s = nth(self.committed(), s)
        if restart:
            self.world.restart(s)
        else:
            self._say(s, Abort)
            self.world.flight = [c for c in self.world.flight if c.what != "Cancel"]
        rivals = [t for t in self.at_rest() if t != s]
        if rival and rivals:
            self._session(rivals[0], "ACTUATING", LEASES[0])

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
        s = nth((self.bound() if bound else []) or world.ids, s)
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
