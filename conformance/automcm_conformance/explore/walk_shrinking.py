"""The shortest walk after which the station still breaks the same rule, found on the station."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

from automcm_conformance.exchange.exchange import Broken
from automcm_conformance.exchange.play import Wrong, offered
from automcm_conformance.exchange.tours import Pair
from automcm_conformance.explore.walks import Act, Coverage, Setting
from automcm_spec.graph.oracle import Oracle
from automcm_spec.vocabulary.station import State

NEAREST = 600
"""Pairs of the broken rule that are tried, nearest to the initial state first."""
TOGETHER = 50
"""So many of them at a time."""
RUNS = 400
"""Walks played in order to shorten one."""
STARTS = 20
"""The same for one that ends in a crash: each needs a new process."""
HANG = 6
"""Crashes that a hang counts as: it takes all the time that an answer may."""
ROUND_MS = (1_000, 100, 10)
"""To which pauses are rounded down, if that is enough."""
Attempt = Callable[[Setting, Sequence[Act]], Wrong | None]
"""Plays a walk; what went wrong, if it broke the rule in question."""
Kind = tuple[str, str, int]
First = Callable[[Setting, Sequence[Sequence[Act]]], int | None]
"""Plays walks; the first that broke the rule in question."""


@dataclass(slots=True)
class Short:
    """A walk, what it is played with, and how it ends.

    What follows the wrong answer is never sent, but with ``durations`` it says which timers are to
    expire soon.
    """

    setting: Setting
    acts: list[Act]
    error: Wrong

    @property
    def sent(self) -> int:
        """How many acts there are up to the wrong answer."""
        return min(self.error.steps[-1].place + 1, len(self.acts))


def pair_of(error: Wrong) -> Pair | None:
    """The state and input that were answered wrongly: the last step of the specification."""
    return next((step.pairs[-1] for step in reversed(error.steps) if step.pairs), None)


def _kind(state: State) -> Kind:
    """Phase, role and proposal."""
    return state.phase, state.role, state.proposal


def rule_of(oracle: Oracle, error: Wrong) -> str:
    """The rule that decides there; empty if nothing had been given yet."""
    pair = pair_of(error)
    answer = None if pair is None else oracle.answer(*pair)
    return "" if answer is None else answer.effect.rule


@dataclass(slots=True)
class Shrinker:
    """Shortens walks over a ground.  ``timed``: the station has ``durations``."""

    coverage: Coverage
    attempt: Attempt
    first: First
    timed: bool
    broken: Callable[[], int]
    """How often the station has crashed; a hang counts as HANG crashes."""
    runs: int = RUNS
    near: int = NEAREST
    _most: int = 0

    @property
    def _ended(self) -> bool:
        """Enough has been tried."""
        return self.runs <= 0 or self.broken() >= self._most

    def shrink(self, found: Short) -> Short:
        """A short walk that breaks the same rule as ``found``."""
        kind = found.error.kind if isinstance(found.error, Broken) else ""
        if kind == "hang":
            return found
        self.runs = STARTS if kind else RUNS
        self._most = self.broken() + STARTS
        if pair_of(found.error) is None:  # not even the first input was reached
            return self._try(Setting(self.timed), []) or self._try(found.setting, []) or found
        best = self._from_afar(self._in_any_time(found) if self.timed else found)
        if best.setting.timed and not kind:
            best = self.nearest(best)
        length = best.sent + 1
        while best.sent < length:
            length = best.sent
            best = self._from_afar(self._fewer(best))
        return self._simpler(best)

    def _try(self, setting: Setting, acts: Sequence[Act]) -> Short | None:
        """This walk, if it breaks the rule; without its end, if it does so too."""
        if self._ended:
            return None
        self.runs -= 1
        if setting.timed:
            acts = [Act(0, i) for i in offered(self.coverage.oracle, [act.input for act in acts])]
        error = self.attempt(setting, acts)
        if error is None:
            return None
        whole = Short(setting, list(acts), error)
        if whole.sent >= len(acts):
            return whole
        cut = list(acts[: whole.sent])
        error = self.attempt(setting, cut)
        return whole if error is None else Short(setting, cut, error)

    def _in_any_time(self, found: Short) -> Short:
        """The same inputs and expiries at times of our own, with the plainest values that do."""
        acts = found.acts
        if not found.setting.timed:
            acts = [Act(0, i) for step in found.error.steps for _, i in step.pairs]
        for setting in (Setting(True), replace(found.setting, timed=True, parameters=())):
            short = self._try(setting, acts)
            if short is not None:
                return short
        return found

    def nearest(self, found: Short) -> Short:
        """The shortest way to break the rule by the graph alone, if it is shorter: with the same
        input where phase, role and proposal are the same, with the same input, with any."""
        pair = pair_of(found.error)
        assert pair is not None
        state, i = pair
        oracle = self.coverage.oracle
        alike, any_ = _kind(oracle.states[state]), range(len(oracle.inputs))
        kinds: list[tuple[Sequence[int], Kind | None]] = [([i], alike), ([i], None), (any_, None)]
        timer = found.error.steps[-1].next_timer
        shown = Setting(True, soonest=timer[0] if timer else "")
        for setting in (found.setting, shown):
            for inputs, kind in kinds:
                walks = self._by_distance(pair, found.sent, inputs, kind)
                found = self._nearest_of(walks, setting) or found
        return found

    def _nearest_of(self, walks: Iterator[list[Act]], setting: Setting) -> Short | None:
        """The first of some walks that breaks the rule."""
        some = list(islice(walks, self.near))
        for at in range(0, len(some), TOGETHER):
            if self._ended:
                break
            together = some[at : at + TOGETHER]
            n = self.first(setting, together)
            short = None if n is None else self._try(setting, together[n])
            if short is not None:
                return short
        return None

    def _by_distance(
        self, pair: Pair, below: int, inputs: Sequence[int], kind: Kind | None
    ) -> Iterator[list[Act]]:
        """Shortest walks to each pair of these inputs, and of this kind of state if it is given,
        with the rule of this pair; shortest first."""
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
                if not self.coverage.offered[i]:
                    continue
                answer = oracle.answer(state, i)
                if answer is not None and answer.effect.rule == broken.effect.rule:
                    yield [Act(0, j) for j in (*oracle.path(state), i)]

    def _from_afar(self, found: Short) -> Short:
        """The last few acts after the shortest way to where they begin."""
        if not found.setting.timed:
            return found
        oracle = self.coverage.oracle
        states = oracle.way(act.input for act in found.acts[: found.sent])
        length = 1
        while length < found.sent:
            start = found.sent - length
            way = [Act(0, i) for i in oracle.path(states[start])]
            short = self._try(found.setting, [*way, *found.acts[start:]])
            if short is not None and short.sent < found.sent:
                return short
            length *= 2
        return found

    def _fewer(self, found: Short) -> Short:
        """Without each act that is not needed."""
        size = len(found.acts) // 2
        while size > 0:
            at = 0
            while at < len(found.acts) and not self._ended:
                short = self._without(found, at, size)
                if short is None:
                    at += size
                else:
                    found = short
            size //= 2
        return found

    def _without(self, found: Short, at: int, size: int) -> Short | None:
        """Without some acts, and without the time that they took or with it."""
        left, away, right = found.acts[:at], found.acts[at : at + size], found.acts[at + size :]
        short = self._try(found.setting, [*left, *right])
        if short is None and right and not found.setting.timed:
            pause = right[0].pause_ms + sum(act.pause_ms for act in away)
            short = self._try(found.setting, [*left, Act(pause, right[0].input), *right[1:]])
        return short if short is not None and len(short.acts) < len(found.acts) else None

    def _simpler(self, found: Short) -> Short:
        """With plain values, the usual parameters and round pauses, where that is enough."""
        plain = Setting(found.setting.timed)
        for name in ("values", "rich", "parameters", "lease_ms", "soonest"):
            setting = replace(found.setting, **{name: getattr(plain, name)})
            if setting != found.setting:
                found = self._try(setting, found.acts) or found
        for n in range(len(found.acts)):
            pauses = (
                [found.acts[n].pause_ms // ms * ms for ms in ROUND_MS] if n < found.sent else []
            )
            for pause in dict.fromkeys([0, *pauses]):
                if n >= len(found.acts) or pause >= found.acts[n].pause_ms:
                    break
                acts = [*found.acts[:n], Act(pause, found.acts[n].input), *found.acts[n + 1 :]]
                short = self._try(found.setting, acts)
                if short is not None:
                    found = short
                    break
        return found
