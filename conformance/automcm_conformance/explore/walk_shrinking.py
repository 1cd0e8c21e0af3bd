"""Shortens a failing walk: the station must still break the same rule at its end."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.exchange.exchange import Broken, Wrong
from automcm_conformance.exchange.play import offered
from automcm_conformance.exchange.tours import Pair
from automcm_conformance.explore.walks import Act, Setting, WalkCoverage
from automcm_spec.graph.oracle import Oracle
from automcm_spec.support.shortening import with_fewer_parts
from automcm_spec.vocabulary.station import State

NEAREST = 600
"""At most this many pairs of the broken rule are tried, nearest to the initial state first."""
RUNS = 400
"""At most this many walks are played to shorten one."""
STARTS = 20
"""The same for a walk that ends in a crash, because each needs a new process."""
HANG = 6
"""A hang counts as this many crashes, because it takes the whole time limit of an answer."""
Attempt = Callable[[Setting, Sequence[Act]], Wrong | None]
"""Plays a walk; returns its failure if that breaks the rule in question."""
Kind = tuple[str, str, int]


@dataclass(slots=True)
class FailingWalk:
    """A walk, its setting and its failure.

    Acts after the wrong answer are never sent, but with ``durations`` they determine which timers
    expire soon.
    """

    setting: Setting
    acts: list[Act]
    error: Wrong

    @property
    def sent(self) -> int:
        """The number of acts up to the wrong answer."""
        return min(self.error.steps[-1].place + 1, len(self.acts))


def pair_of(error: Wrong) -> Pair | None:
    """The state and input with the wrong answer: the last step of the specification."""
    return next((step.pairs[-1] for step in reversed(error.steps) if step.pairs), None)


def _kind(state: State) -> Kind:
    """Phase, role and proposal."""
    return state.phase, state.role, state.proposal


def rule_of(oracle: Oracle, error: Wrong) -> str:
    """The rule that decides at the failure; empty before the first input."""
    pair = pair_of(error)
    answer = None if pair is None else oracle.answer(*pair)
    return "" if answer is None else answer.effect.rule


@dataclass(slots=True)
class Shrinker:
    """Shortens walks over a graph.  ``timed``: the station has the feature ``durations``."""

    coverage: WalkCoverage
    attempt: Attempt
    timed: bool
    adapter: Adapter
    runs: int = RUNS
    near: int = NEAREST
    _max_broken: int = 0

    @property
    def _ended(self) -> bool:
        """Whether the attempts are used up."""
        return self.runs <= 0 or self._broken >= self._max_broken

    @property
    def _broken(self) -> int:
        """The number of crashes so far; a hang counts as HANG crashes."""
        return self.adapter.broken + (HANG - 1) * self.adapter.hung

    def shrink(self, found: FailingWalk) -> FailingWalk:
        """A short walk that breaks the same rule as ``found``."""
        kind = found.error.kind if isinstance(found.error, Broken) else ""
        if kind == "hang":
            return found
        self.runs = STARTS if kind else RUNS
        self._max_broken = self._broken + STARTS
        if pair_of(found.error) is None:  # not even the first input was reached
            return self._try(Setting(self.timed), []) or self._try(found.setting, []) or found
        best = self._from_afar(self._as_timed(found) if self.timed else found)
        if best.setting.timed and not kind:
            best = self.nearest(best)
        length = best.sent + 1
        while best.sent < length:
            length = best.sent
            fewer = with_fewer_parts(best, lambda walk: len(walk.acts), self._without)
            best = self._from_afar(fewer)
        return self._simpler(best)

    def _try(self, setting: Setting, acts: Sequence[Act]) -> FailingWalk | None:
        """This walk if it breaks the rule, without its unsent end if that fails too."""
        if self._ended:
            return None
        self.runs -= 1
        if setting.timed:
            acts = [Act(0, i) for i in offered(self.coverage.oracle, [act.input for act in acts])]
        error = self.attempt(setting, acts)
        if error is None:
            return None
        complete = FailingWalk(setting, list(acts), error)
        if complete.sent >= len(acts):
            return complete
        cut = list(acts[: complete.sent])
        error = self.attempt(setting, cut)
        return complete if error is None else FailingWalk(setting, cut, error)

    def _as_timed(self, found: FailingWalk) -> FailingWalk:
        """The same inputs and expiries with durations that the kit sets, if that still fails."""
        acts = found.acts
        if not found.setting.timed:
            acts = [Act(0, i) for step in found.error.steps for _, i in step.pairs]
        for setting in (Setting(True), replace(found.setting, timed=True, parameters=())):
            short = self._try(setting, acts)
            if short is not None:
                return short
        return found

    def nearest(self, found: FailingWalk) -> FailingWalk:
        """The shortest failing walk along the graph, if shorter than ``found``.

        Tried in this order: the same input in states of the same phase, role and proposal, the same
        input in any state, any input.
        """
        pair = pair_of(found.error)
        assert pair is not None
        state, i = pair
        oracle = self.coverage.oracle
        same_kind, any_ = _kind(oracle.states[state]), range(len(oracle.inputs))
        kinds: list[tuple[Sequence[int], Kind | None]] = [
            ([i], same_kind),
            ([i], None),
            (any_, None),
        ]
        timer = found.error.steps[-1].next_timer
        shown = Setting(True, soonest=timer[0] if timer else "")
        for setting in (found.setting, shown):
            for inputs, kind in kinds:
                walks = self._by_distance(pair, found.sent, inputs, kind)
                found = self._nearest_of(walks, setting) or found
        return found

    def _nearest_of(self, walks: Iterator[list[Act]], setting: Setting) -> FailingWalk | None:
        """The first of these walks that breaks the rule."""
        for acts in islice(walks, self.near):
            if self._ended:
                break
            if self.attempt(setting, acts) is not None and (short := self._try(setting, acts)):
                return short
        return None

    def _by_distance(
        self, pair: Pair, below: int, inputs: Sequence[int], kind: Kind | None
    ) -> Iterator[list[Act]]:
        """Shortest walks to pairs with the rule of ``pair``, shorter than ``below``, in order.

        Only pairs with one of ``inputs`` and, unless it is None, with a state of this kind.
        """
        oracle = self.coverage.oracle
        broken = oracle.given(*pair)
        depth = [0] * len(oracle.states)
        for state in range(1, len(oracle.states)):
            depth[state] = depth[oracle.parents[state][0]] + 1
        for state in sorted(range(len(oracle.states)), key=depth.__getitem__):
            if depth[state] + 1 >= below:
                return
            if kind is not None and _kind(oracle.states[state]) != kind:
                continue
            for i in inputs:
                answer = oracle.answer(state, i) if self.coverage.allowed(state, i) else None
                if answer is not None and answer.effect.rule == broken.effect.rule:
                    yield [Act(0, j) for j in (*oracle.path(state), i)]

    def _from_afar(self, found: FailingWalk) -> FailingWalk:
        """The last acts only, after the shortest path to the state where they begin."""
        if not found.setting.timed:
            return found
        oracle = self.coverage.oracle
        states = oracle.way(act.input for act in found.acts[: found.sent])
        length = 1
        while length < found.sent:
            start = found.sent - length
            path = [Act(0, i) for i in oracle.path(states[start])]
            short = self._try(found.setting, [*path, *found.acts[start:]])
            if short is not None and short.sent < found.sent:
                return short
            length *= 2
        return found

    def _without(self, found: FailingWalk, at: int, size: int) -> FailingWalk | None:
        """The walk without ``size`` acts, with or without their pauses."""
        left, removed, right = found.acts[:at], found.acts[at : at + size], found.acts[at + size :]
        short = self._try(found.setting, [*left, *right])
        if short is None and right and not found.setting.timed:
            pause = right[0].pause_ms + sum(act.pause_ms for act in removed)
            short = self._try(found.setting, [*left, Act(pause, right[0].input), *right[1:]])
        return short if short is not None and len(short.acts) < len(found.acts) else None

    def _simpler(self, found: FailingWalk) -> FailingWalk:
        """The walk with plain values, usual parameters and no pauses, where it still fails."""
        plain = Setting(found.setting.timed)
        for name in ("values", "rich", "parameters", "lease_ms", "soonest"):
            setting = replace(found.setting, **{name: getattr(plain, name)})
            if setting != found.setting:
                found = self._try(setting, found.acts) or found
        for n, act in enumerate(found.acts[: found.sent]):
            if act.pause_ms and n < found.sent:
                acts = [*found.acts[:n], Act(0, act.input), *found.acts[n + 1 :]]
                found = self._try(found.setting, acts) or found
        return found
