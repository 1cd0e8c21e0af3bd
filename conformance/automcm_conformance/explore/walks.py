"""Walks through a graph that prefer new transitions, with a radio that repeats and delays.

A walk is a list of acts, none of which depends on the station's answers.  So the same acts, or
some of them, can be played again.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from random import Random
from typing import NamedTuple

from automcm_conformance.exchange.exchange import Exchange
from automcm_conformance.exchange.play import play
from automcm_conformance.exchange.tours import Allowed, Pair
from automcm_conformance.exchange.wire import LONG_MS, PLAIN, Values
from automcm_spec.graph.oracle import Oracle
from automcm_spec.vocabulary.station import Cam, Expire, Receive

NOTHING = -1
"""The input of an act that only advances time."""
TRIES = 6
"""Inputs tried in the search for one that has not been given in a state."""
NEAR = 300
"""States searched for a transition that no walk has taken."""
STARTS = 24
"""States drawn at random, of which the least visited is taken."""
PAUSES_MS = (0, 0, 1, 7, 30, 99)
PLANNED, JUDGED = 1, 2


class Act(NamedTuple):
    """An input, ``pause_ms`` after the act before; the pause only matters in natural time."""

    pause_ms: int
    input: int


@dataclass(frozen=True, slots=True)
class Faults:
    """How often a walk disturbs the station, in percent of its inputs.

    ``again``: repeat the last message.  ``late``: repeat an earlier message.  ``no_op``: an input
    that must change nothing.  ``silent``: no input until a timer expires.
    """

    again: int = 0
    late: int = 0
    no_op: int = 0
    silent: int = 0

    def __str__(self) -> str:
        return f"again{self.again}-late{self.late}-odd{self.no_op}-silent{self.silent}"


@dataclass(frozen=True, slots=True)
class Setting:
    """The conditions of a walk.

    ``timed``: the kit sets the durations of timers, so that they can expire in any order.  If not,
    the walk is in natural time: timers have the durations of the parameters.
    """

    timed: bool
    parameters: tuple[tuple[str, int], ...] = ()
    """The parameters that differ from those of the suite."""
    values: Values = PLAIN
    rich: bool = False
    lease_ms: int = LONG_MS
    soonest: str = ""
    """``timed``: the timer with the shortest duration, of those that need not expire."""


@dataclass(slots=True)
class WalkCoverage:
    """A graph, with the pairs of state and input that may be walked and that have been."""

    oracle: Oracle
    allowed: Allowed
    """Whether the station can be given this input in this state (``Runner.allowed``)."""
    avoided: set[Pair] = field(default_factory=set)
    """Pairs with a wrong answer."""
    _seen: bytearray = field(init=False)
    _untaken: list[int] = field(init=False)
    """For each state the number of transitions that no walk has taken, forbidden ones included."""
    _visits: Counter[int] = field(default_factory=Counter)
    _fired: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._seen = bytearray(len(self.oracle.states) * len(self.oracle.inputs))
        self._untaken = [len(self.oracle.moves(state)) for state in range(len(self.oracle.states))]

    def may(self, state: int, i: int) -> bool:
        """Whether this input may be given in this state."""
        is_usable = (state, i) not in self.avoided and self.allowed(state, i)
        return is_usable and self.oracle.answer(state, i) is not None

    def fresh(self, state: int, i: int) -> bool:
        """Whether no walk has given this input in this state."""
        return not self._seen[state * len(self.oracle.inputs) + i]

    def mark(self, pair: Pair, how: int) -> None:
        """Mark a pair as PLANNED or JUDGED."""
        at = pair[0] * len(self.oracle.inputs) + pair[1]
        self._untaken[pair[0]] -= not self._seen[at] and self.oracle.is_move(*pair)
        self._seen[at] = max(self._seen[at], how)
        if how == PLANNED:
            self._visits[pair[0]] += 1
            value = self.oracle.inputs[pair[1]]
            if isinstance(value, Expire):
                self._fired[value.timer[0]] += 1

    def counts(self) -> dict[str, list[int]]:
        """The number judged and the total, of transitions and of refusals."""
        oracle, n = self.oracle, len(self.oracle.inputs)
        moves = sum(
            self._seen[state * n + i] == JUDGED
            for state in range(len(oracle.states))
            for i in oracle.moves(state)
        )
        return {
            "transitions": [moves, oracle.transitions],
            "refusals": [self._seen.count(JUDGED) - moves, oracle.refusals],
        }

    def has_new(self, state: int) -> bool:
        """Whether this state has a transition that no walk has taken."""
        return self._untaken[state] > 0

    def rare_state(self, random: Random) -> int:
        """The least visited of some random states."""
        states = [random.randrange(len(self.oracle.states)) for _ in range(STARTS)]
        return min(states, key=lambda state: self._visits[state])

    def path_to_new(self, state: int, *, expiries: bool | None) -> list[int]:
        """Inputs to a near state that ``has_new``; empty if there is none."""
        before: dict[int, Pair] = {}
        near = deque([state])
        while near and len(before) < NEAR:
            here = near.popleft()
            if here != state and self._untaken[here]:
                inputs = []
                while here != state:
                    here, i = before[here]
                    inputs.append(i)
                return inputs[::-1]
            for i, after in self.oracle.moves(here).items():
                expiry = isinstance(self.oracle.inputs[i], Expire)
                if after in before or after == state or expiries not in (None, expiry):
                    continue
                if self.may(here, i):
                    before[after] = here, i
                    near.append(after)
        return []

    def no_op(self, state: int, random: Random) -> int | None:
        """An input that must change nothing in this state, preferably a new one."""
        found = None
        for _ in range(TRIES):
            i = random.randrange(len(self.oracle.inputs))
            if self.oracle.is_move(state, i) or not self.may(state, i):
                continue
            if self.fresh(state, i):
                return i
            found = i
        return found

    def move(self, state: int, random: Random, *, expiries: bool | None) -> int | None:
        """A random transition; new ones, rare states and rare timers are more likely.

        ``expiries``: True for expiries only, False for none, None for all transitions.
        """
        inputs, weights = [], []
        for i, after in self.oracle.moves(state).items():
            value = self.oracle.inputs[i]
            expiry = isinstance(value, Expire)
            if (expiries is not None and expiry != expiries) or not self.may(state, i):
                continue
            rare = self._visits[after]
            if isinstance(value, Expire):
                rare = self._fired[value.timer[0]]
            inputs.append(i)
            weights.append((8.0 if self.fresh(state, i) else 1.0) / (1 + rare) ** 0.5)
        return random.choices(inputs, weights)[0] if inputs else None


@dataclass(slots=True)
class Walker:
    """Generates walks over a graph.  The same ``random`` generates the same walks."""

    coverage: WalkCoverage
    random: Random
    faults: Faults
    _received: list[int] = field(default_factory=list)
    """The messages of this walk."""
    _path: deque[Pair] = field(default_factory=deque)
    """States and inputs on the way to a new transition."""

    def timed(self, length: int) -> list[Act]:
        """A walk to a rarely visited state, and on from there."""
        oracle, tour, state = self.coverage.oracle, list[int](), 0
        for i in oracle.path(self.coverage.rare_state(self.random)):
            if not self.coverage.may(state, i):
                break
            if self.random.randrange(100) < self.faults.no_op:
                no_op = self.coverage.no_op(state, self.random)
                if no_op is not None:
                    self._note(tour, state, no_op)
            state = self._note(tour, state, i)
        while len(tour) < length:
            chosen = self._choose(state, None)
            if chosen is None:
                break
            state = self._note(tour, state, chosen)
        return [Act(0, i) for i in tour]

    def natural(self, x: Exchange, setting: Setting, length: int, acts: list[Act]) -> None:
        """Play a walk from the initial state, by the clock of this exchange.

        The acts are appended to ``acts``, also if Mismatch, Broken or Unpredicted is raised.
        """
        while len(acts) < length and x.clock.sure:
            due = x.next_due
            chosen = self._choose(x.state, False)
            if due is not None and self.random.randrange(100) < self.faults.silent:
                pause = max(0, due - x.now - self.random.choice((0, 0, 1)))
                if due > x.now + pause or self.random.randrange(3):
                    chosen = None  # otherwise the input comes together with the timer
            else:
                pause = self.random.choice(PAUSES_MS)
                if due is not None and x.now + pause >= due:
                    pause = 0
                if chosen is None and due is None:
                    break
            act = Act(pause, NOTHING if chosen is None else chosen)
            if chosen is not None:
                self._note_message(chosen)
            acts.append(act)
            before = len(x.unwritten_steps)
            perform(x, act, setting)
            for step in x.unwritten_steps[before:]:
                for pair in step.pairs:
                    self.coverage.mark(pair, PLANNED)

    def _choose(self, state: int, expiries: bool | None) -> int | None:
        """The next input, or None if there is none."""
        faults, random, die = self.faults, self.random, self.random.randrange(100)
        if self._received and die < faults.again + faults.late:
            old = self._received[-1] if die < faults.again else random.choice(self._received)
            if self.coverage.may(state, old):
                return old
        die = random.randrange(100)
        if die < faults.no_op:
            no_op = self.coverage.no_op(state, random)
            if no_op is not None:
                return no_op
        if expiries is None and die >= 100 - faults.silent:
            expiry = self.coverage.move(state, random, expiries=True)
            if expiry is not None:
                return expiry
        return self._transition(state, expiries)

    def _transition(self, state: int, expiries: bool | None) -> int | None:
        """A transition, in most cases a new one or one on the way to a new one."""
        coverage = self.coverage
        if not coverage.has_new(state) and not self._path and self.random.randrange(4):
            at = state
            for i in coverage.path_to_new(state, expiries=expiries):
                self._path.append((at, i))
                at = coverage.oracle.moves(at)[i]
        if self._path:
            if self._path[0][0] == state:
                return self._path.popleft()[1]
            self._path.clear()  # another input came in between
        return coverage.move(state, self.random, expiries=expiries)

    def _note(self, tour: list[int], state: int, i: int) -> int:
        tour.append(i)
        self._note_message(i)
        self.coverage.mark((state, i), PLANNED)
        return self.coverage.oracle.given(state, i).next

    def _note_message(self, i: int) -> None:
        if isinstance(self.coverage.oracle.inputs[i], Receive | Cam):
            self._received.append(i)


def perform(x: Exchange, act: Act, setting: Setting) -> None:
    """Perform one act in natural time.  An input that is not possible then is left out."""
    at = x.now + act.pause_ms
    while (due := x.next_due) is not None and due < at:
        x.advance(due)
    if act.input == NOTHING or not x.offers(act.input, at):
        x.advance(at)
    else:
        x.give(act.input, at=at, lease_ms=setting.lease_ms)


def walk(x: Exchange, acts: Sequence[Act], setting: Setting) -> None:
    """Play acts on a new exchange, as far as time allows, and end it.

    Raises Mismatch and Broken.
    """
    if setting.timed:
        play(x, [act.input for act in acts], True, soonest=setting.soonest)
        return
    for place, act in enumerate(acts):
        x.place = place
        perform(x, act, setting)
    x.end_with_reset()
