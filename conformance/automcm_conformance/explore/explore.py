"""Exploration: random walks over the graphs against one implementation, until time is up.

The oracle judges each answer, and failing walks are shortened by running them again.  Walks prefer
inputs that have not been given yet.  The seed and the number of a walk determine it completely;
only the number of walks depends on time.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.exchange import records
from automcm_conformance.exchange.confirmation import in_fresh_process
from automcm_conformance.exchange.exchange import Exchange, Mismatch, Unpredicted, Wrong
from automcm_conformance.exchange.results import CaseResult, Exploration
from automcm_conformance.exchange.wire import LONG, LONG_MS, VALUES
from automcm_conformance.explore.walk_shrinking import FailingWalk, Shrinker, pair_of, rule_of
from automcm_conformance.explore.walks import (
    JUDGED,
    Act,
    Faults,
    Setting,
    WalkCoverage,
    Walker,
    walk,
)
from automcm_conformance.suite.graph_cases import PARAMETERS as USUAL
from automcm_conformance.suite.graph_cases import Notify, Runner
from automcm_conformance.suite.purposes import input_kind
from automcm_conformance.suite.suite_run import keeping_results
from automcm_conformance.suite.verdicts import failure, implementation
from automcm_spec.graph.oracle import Oracle, load
from automcm_spec.graph.oracle_generation import ONE_PEER, TIGHT, TWO_PEERS
from automcm_spec.graph.oracle_generation import spec_hash as present_hash
from automcm_spec.support.collection import uncollected

GRAPHS = (ONE_PEER, TWO_PEERS, TIGHT)
LENGTHS = (20, 60, 120)
"""Possible numbers of acts in a walk."""
WEIGHTS = {"one-peer": 3, "two-peers": 5, "tight": 1}
PARAMETERS: tuple[tuple[tuple[str, int], ...], ...] = (
    (),
    (("t_timeout", 0), ("t_cam_loss", 1001)),
    (("t_timeout", 1000), ("t_decide", 170)),
    (("t_timeout", 250), ("t_resend", 60), ("t_decide", 2500), ("t_cam_loss", 3000)),
)
"""Changes to the suite's parameters, for walks in natural time."""
LEASES_MS = (300, 1_700, 9_000, LONG_MS)


@dataclass(slots=True)
class Walk:
    """One walk."""

    number: int
    coverage: WalkCoverage
    faults: Faults
    setting: Setting
    acts: list[Act]

    def id(self, seed: int) -> str:
        """The case id: seed and number determine the walk, the rest describes it."""
        times = "durations" if self.setting.timed else "natural"
        return f"EXPLORE/{seed}/{self.number}/{self.coverage.oracle.name}/{times}/{self.faults}"


class Explorer:
    """Walks against the adapter of a runner; replays and logs are written to ``folder``.

    The exploration ends after ``enough`` different failures.
    """

    def __init__(
        self, runner: Runner, oracles: Sequence[Oracle], folder: Path, seed: int, enough: int
    ) -> None:
        self.runner = runner
        self.seed = seed
        self._folder = folder
        self._enough = enough
        fit = (o for o in oracles if not runner.unfit(o))
        self.coverages = [WalkCoverage(o, runner.allowed(o)) for o in fit]
        self.found = Exploration(implementation(runner), seed, oracles[0].spec_hash)
        self._known: set[tuple[str, ...]] = set()

    def run(self, more: Callable[[int], bool]) -> None:
        """Walk while ``more``, called with the number of walks, returns true."""
        if not self.coverages:
            self.found.problems.append("no graph has the fixed limits of the implementation")
            return
        found, runner = self.found, self.runner
        while len(found.cases) < self._enough and not runner.cut_short and more(found.walks):
            self._walk(self.found.walks + 1)
            self.runner.notify(f"{self.found.walks:,} walks, {self.found.lines:,} lines")

    # -- walks

    def _walk(self, number: int) -> None:
        """Play a new walk and judge it."""
        random = Random(f"{self.seed}/{number}")
        weights = [WEIGHTS[coverage.oracle.name] for coverage in self.coverages]
        coverage = random.choices(self.coverages, weights)[0]
        faults = Faults(
            random.choice((0, 5, 20)),
            random.choice((0, 5, 20)),
            random.choice((10, 40, 70)),
            random.choice((5, 20, 50)),
        )
        timed = self.runner.timed and random.randrange(3) > 0
        setting = Setting(
            timed,
            () if timed else random.choice(PARAMETERS),
            random.choice(VALUES),
            random.randrange(8) == 0,
            LONG_MS if timed else random.choice(LEASES_MS),
            random.choice(tuple(LONG)) if timed else "",
        )
        walker, length = Walker(coverage, random, faults), random.choice(LENGTHS)
        new = Walk(number, coverage, faults, setting, [])
        x, wrong = self._exchange(coverage, setting, predict=self.runner.predict), None
        try:
            if timed:
                new.acts = walker.timed(length)
                walk(x, new.acts, setting)
            else:
                walker.natural(x, setting, length, new.acts)
                x.end_with_reset()
            x.flush()
        except Unpredicted:
            self.runner.predict = False
        except Wrong as error:
            wrong = error
        self.found.walks += 1
        self.found.lines += len(x.done if wrong is None else wrong.steps)
        for pair in (pair for step in x.done for pair in step.pairs):
            coverage.mark(pair, JUDGED)
        if wrong is not None:
            self._handle_failure(new, wrong)

    def _exchange(
        self, coverage: WalkCoverage, setting: Setting, *, predict: bool = False
    ) -> Exchange:
        return self.runner.exchange(
            coverage.oracle,
            {**USUAL, **dict(setting.parameters)},
            rich=setting.rich,
            values=setting.values,
            predict=predict,
        )

    # -- judging

    def _handle_failure(self, each: Walk, error: Wrong) -> None:
        """Confirm, shorten and report a failing walk, unless an equal failure is known."""
        oracle, adapter = each.coverage.oracle, self.runner.adapter
        self.runner.resynchronize(error)
        signature = _signature(oracle, error)
        if signature in self._known:
            self.found.again += 1
            return
        self._known.add(signature)
        counts = adapter.broken, adapter.hung
        error = in_fresh_process(adapter, error, repeated=False)
        acts = each.acts
        if not error.unconfirmed:
            self._known.add(_signature(oracle, error))
            attempt = partial(self._attempt, each, rule_of(oracle, error))
            shrinker = Shrinker(each.coverage, attempt, self.runner.timed, adapter)
            try:
                short = shrinker.shrink(FailingWalk(each.setting, acts, error))
                acts = short.acts
                error = in_fresh_process(adapter, short.error, repeated=True)
            except KeyboardInterrupt:
                self._report(each, error, len(acts))
                raise
            adapter.broken, adapter.hung = counts  # repetitions do not count
        self._known.add(_signature(oracle, error))
        if (pair := pair_of(error)) is not None and not error.unconfirmed:
            each.coverage.avoided.add(pair)
        self._report(each, error, min(error.steps[-1].place + 1, len(acts)))

    def _attempt(
        self, each: Walk, rule: str, setting: Setting, acts: Sequence[Act]
    ) -> Wrong | None:
        """Play one walk; returns its failure if that breaks ``rule``."""
        x = self._exchange(each.coverage, setting)
        try:
            walk(x, acts, setting)
            x.flush()
        except Wrong as error:
            self.runner.resynchronize(error)
            return error if rule == rule_of(each.coverage.oracle, error) else None
        return None

    def _report(self, each: Walk, error: Wrong, acts: int) -> None:
        runner, oracle, case = self.runner, each.coverage.oracle, each.id(self.seed)
        runner.labelled(oracle, pair_of(error), error, None)
        described = failure(runner, case, 1, error, self._folder)
        given = f"a walk over {oracle.name} with {each.faults}"
        self.found.cases.append(
            CaseResult(
                id=case,
                verdict=error.verdict,
                rules=[described.rule] if described.rule else [],
                level="MUST",
                given=given,
                when="",
                then="",
                bug="",
                cost="",
                reason=described.what,
                failures=[described],
                log=records.log_of(self._folder, case, error.steps, runner.adapter.hello),
            )
        )
        self.found.acts[case] = acts


def _signature(oracle: Oracle, error: Wrong) -> tuple[str, ...]:
    """Equal failures have equal signatures: rule, kind of input, wrong parts of the answer."""
    pair = pair_of(error)
    about = "nothing" if pair is None else input_kind(oracle.inputs[pair[1]])
    parts = error.parts if isinstance(error, Mismatch) else {error.difference}
    return rule_of(oracle, error), about, *sorted(parts)


def explore(
    command: Sequence[str],
    folder: Path,
    *,
    limit_s: float,
    seed: int,
    enough: int,
    notify: Notify,
    more: Callable[[int], bool],
) -> Exploration:
    """Walk against the adapter that ``command`` starts, while ``more`` returns true.

    Raises AdapterError or ProtocolError if the adapter does not answer hello, and OracleError.
    After an internal error or an interruption it returns the results so far.
    """
    spec = present_hash()
    with uncollected():
        oracles = [load(graph.path, spec) for graph in GRAPHS]
    adapter = Adapter(command, limit_s)
    runner = Runner(adapter, (), seed, notify)
    explorer = Explorer(runner, oracles, folder, seed, enough)
    found = explorer.found
    gc.collect()
    gc.freeze()  # keeps the graphs out of garbage collection
    try:
        with keeping_results(runner):
            explorer.run(more)
    finally:
        gc.unfreeze()
    found.broke = runner.broke
    found.problems += filter(None, [runner.cut_short, *adapter.problems])
    found.coverage = {g.oracle.name: g.counts() for g in explorer.coverages}
    return found
