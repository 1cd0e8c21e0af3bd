"""Tours: sequences of inputs that together drive chosen pairs of state and input of a graph, and
the time-table that makes each of them possible."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from automcm_conformance.exchange.wire import LONG, STEP_MS
from automcm_spec.graph.oracle import Oracle, OracleAnswer
from automcm_spec.vocabulary.station import Command, Expire, Message, Receive, Timer

Pair = tuple[int, int]
"""(state, input) of a graph."""
Allowed = Callable[[int, int], bool]
LATER_MS = 30
TRIES = 4
"""The number of inputs tried in the search for one that changes nothing."""
LONGEST = 600
"""The approximate length of a tour in inputs: one wrong answer must not hide too much."""


class Tours:
    """The pairs that are still to be driven, each for its case, and the next tour.

    ``allowed(state, input)``: a tour may use this transition. ``disturbs``: an input that must
    change nothing may be given on the way; ``seed`` chooses among these. A pair that was answered
    wrongly is ``avoid``ed; pairs that can only be reached through it stay in ``left``.
    """

    def __init__(
        self,
        oracle: Oracle,
        targets: Iterable[tuple[OracleAnswer, str]],
        allowed: Allowed,
        disturbs: Callable[[OracleAnswer], bool],
        seed: int = 1,
    ) -> None:
        self.oracle, self.allowed, self.disturbs = oracle, allowed, disturbs
        self.left: dict[int, dict[Pair, str]] = {}
        """For each state the pairs to drive, each with its case."""
        for answer, case in targets:
            self.left.setdefault(answer.state, {})[answer.state, answer.input] = case
        self.planned: set[Pair] = set()
        """The pairs of unfinished tours."""
        self._sent: set[Pair] = set()
        """The pairs of the tours that the station is answering."""
        self.avoided: set[Pair] = set()
        self._moves: dict[int, list[OracleAnswer]] = {}
        self._parents: dict[int, Pair] | None = None
        self._disturbing: dict[Pair, bool] = {}
        self._random = random.Random(seed)

    def next(self) -> list[int] | None:
        """The inputs of the next tour, from the initial state; None if no reachable pair is
        unplanned.

        At each state, first all inputs that stay there, then a transition that has not been driven,
        as long as there is one. On the way to the first of these states, each step is preceded by
        an input that must change nothing: a hidden change may show later.
        """
        parents, planned = self._tree(), self.planned
        # From far away ways lead back to states where there is still much to do.
        far = (s for s in reversed(self.left) if s in parents)
        start = next((s for s in far if not self.left[s].keys() <= planned), None)
        if start is None:
            return None
        tour, state = self._disturbed(self.path(start) or []), start
        while len(tour) < LONGEST:
            here = [pair[1] for pair in self.left.get(state, ()) if pair not in planned]
            moves = self.oracle.moves(state)
            still = [i for i in here if i not in moves]
            still += [i for i in here if moves.get(i) == state]
            tour += still
            planned.update((state, i) for i in still)
            on = next((i for i in here if moves.get(i, state) != state), None)
            if on is None:
                break
            planned.add((state, on))
            tour.append(on)
            state = moves[on]
        return tour

    def _disturbed(self, way: list[int]) -> list[int]:
        """A way, with an input that must change nothing before each step."""
        tour, state, inputs = [], 0, range(len(self.oracle.inputs))
        for i in way:
            for _ in range(TRIES):
                pair = state, self._random.choice(inputs)
                if self._disturbs(pair) and pair not in self.avoided:
                    tour.append(pair[1])
                    break
            tour.append(i)
            state = self.oracle.next(state, i)
        return tour

    def _disturbs(self, pair: Pair) -> bool:
        """Whether the input must change nothing and may be given; cached, since ways share their
        beginning."""
        known = self._disturbing.get(pair)
        if known is None:
            answer = self.oracle.answer(*pair)
            known = answer is not None and not answer.changes and self.disturbs(answer)
            self._disturbing[pair] = known
        return known

    def done(self, pair: Pair) -> str | None:
        """Mark this pair as driven. Returns its case if it was still to be driven."""
        here = self.left.get(pair[0])
        if here is None:
            return None
        case = here.pop(pair, None)
        if not here:
            del self.left[pair[0]]
        return case

    def avoid(self, pair: Pair) -> str | None:
        """Do not use this pair any more. Returns the same as ``done``."""
        self.avoided.add(pair)
        self._moves.pop(pair[0], None)
        self._parents = None
        return self.done(pair)

    def mark_sent(self) -> None:
        """Forget the tours that were answered, and mark those planned since as sent."""
        self._sent, self.planned = self.planned - self._sent, self.planned - self._sent

    def forget_plans(self) -> None:
        """Finish all tours."""
        self.planned.clear()
        self._sent.clear()

    def end(self) -> None:
        """Free the memory that only planning needs."""
        self.forget_plans()
        for cache in (self._moves, self._disturbing):
            cache.clear()
        self._parents = None

    def usable(self, pairs: Iterable[Pair]) -> None:
        """Use these pairs again."""
        self.avoided.difference_update(pairs)
        self._moves.clear()
        self._parents = None

    def drop(self, case: str) -> None:
        """Test no more pairs of this case."""
        pairs = [pair for here in self.left.values() for pair, c in here.items() if c == case]
        self.avoided.update(pair for pair in pairs if not self.oracle.is_move(*pair))
        for pair in pairs:
            self.done(pair)

    def path(self, state: int) -> list[int] | None:
        """A shortest way to a state; None if there is none left."""
        parents, inputs = self._tree(), []
        if state not in parents:
            return None
        while state != 0:
            state, i = parents[state]
            inputs.append(i)
        return inputs[::-1]

    def _tree(self) -> dict[int, Pair]:
        if self._parents is None:
            self._parents = {0: (0, 0)}
            queue = deque([0])
            while queue:
                state = queue.popleft()
                for answer in self._from(state):
                    if answer.next not in self._parents:
                        self._parents[answer.next] = (state, answer.input)
                        queue.append(answer.next)
        return self._parents

    def _from(self, state: int) -> list[OracleAnswer]:
        if state not in self._moves:
            self._moves[state] = [
                answer
                for answer in self.oracle.changes(state)
                if (state, answer.input) not in self.avoided and self.allowed(state, answer.input)
            ]
        return self._moves[state]


@dataclass(slots=True)
class Slot:
    """The time of an input of a tour, the durations of the timers that it arms, and the lease of a
    Prescription (None: no new one)."""

    answer: OracleAnswer
    at: int
    durations: dict[str, int]
    lease_ms: int | None = None


def timetable(
    oracle: Oracle, tour: Sequence[int], start: int, long: Mapping[str, int] = LONG
) -> list[Slot]:
    """A time for each input of a tour such that each timer that expires in it expires in turn.

    Each transition takes STEP_MS; a timer that does not expire in the tour lasts ``long``. An input
    that must change nothing comes LATER_MS after a transition, so that a timer that it wrongly arms
    again shows.
    """
    slots: list[Slot] = []
    running: dict[Timer, int] = {}
    lease_from = -1
    state, now = 0, start + STEP_MS // 2
    for n, i in enumerate(tour):
        answer = oracle.answer(state, i)
        if answer is None:
            raise ValueError(f"the oracle does not offer this input here: {oracle.inputs[i]}")
        if answer.changes:
            now += STEP_MS
        slot = Slot(answer, now if answer.changes else now + LATER_MS, {})
        slots.append(slot)
        if not answer.changes:
            continue
        value = oracle.inputs[i]
        if isinstance(value, Expire):
            armed = running.pop(value.timer)
            name = value.timer[0]
            if name == "lease":
                slots[lease_from].lease_ms = now - slots[armed].at
            else:
                slots[armed].durations[name] = now - slots[armed].at
        match value:
            case (
                Receive(message=Message(type="Prescription", proposal=proposal))
                | Command(name="prescribe", proposal=proposal)
            ):
                lease_from, slot.lease_ms = n, long["lease"] + proposal
        for timer in answer.effect.stop:
            running.pop(timer, None)
        for timer in answer.effect.arm:
            running[timer] = n
            if timer[0] != "lease":
                slot.durations.setdefault(timer[0], long[timer[0]])
        state = answer.next
    return slots
