"""What can happen to stations in the stateful tests by the radio, by time and by crashes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, ClassVar, TypeVar

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule
from stateful_odd import odd_messages
from stateful_oracle import ALL, IDS, Coverage, Setup, setup
from stateful_world import World

from automcm_spec.vocabulary.messages import encode

T = TypeVar("T")


def step(**strategies: Any) -> Callable[[Any], Any]:
    """A rule whose calls are recorded, so that a run can be printed and repeated."""

    def wrap(function: Any) -> Any:
        @wraps(function)
        def called(self: Surroundings, **drawn: Any) -> None:
            self.begin(function.__name__, drawn)
            function(self, **drawn)

        return rule(**strategies)(called)

    return wrap


def nth(of: Sequence[T], n: int) -> T:
    return of[n % len(of)]


Call = tuple[str, dict[str, Any]]
"""A rule and its drawn arguments."""

SOME = st.integers(0, 11)
STATION = st.integers(0, 3) | st.integers(0, len(IDS) - 1)
FEW = st.integers(1, 4)
LATE = st.booleans()
LOST = st.sampled_from(("", "Ack", "Cancel", "Acceptance", "Intention", "Prescription"))
"""Messages of this type are lost."""


class Surroundings(RuleBasedStateMachine):
    """Each rule is one thing that can happen, or a few that often happen together.

    A number chooses among what there is, modulo how much there is, so that it stays meaningful
    while hypothesis shrinks.
    """

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
        return World(setup, checks=self.checks, coverage=self.coverage)

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

    def bound(self) -> list[int]:
        return [s for s in self.world.up() if self.world.state(s).bound]

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
        """A station (one in a session, if possible) receives a message that must have no effect."""
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
