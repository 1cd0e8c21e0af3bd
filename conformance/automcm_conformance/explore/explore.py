"""Exploration: random walks over the graphs against one implementation, until time is up.

The oracle judges each answer, and failing walks are shortened by running them again.  Walks prefer
inputs that have not been given yet.  The seed and the number of a walk determine it completely;
only the number of walks depends on time.
"""

from __future__ import annotations

import gc
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from automcm_conformance.adapter.adapter import Adapter, LineByLine
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import Refused
from automcm_conformance.exchange import records, transcript
from automcm_conformance.exchange.deciding import Deciding, deciding
from automcm_conformance.exchange.exchange import (
    Broken,
    Exchange,
    LineLink,
    Mismatch,
    Step,
    Unpredicted,
)
from automcm_conformance.exchange.play import Wrong
from automcm_conformance.exchange.results import BROKE, NONDETERMINISTIC, CaseResult, Exploration
from automcm_conformance.exchange.wire import LONG, LONG_MS, VALUES
from automcm_conformance.explore.walk_shrinking import (
    HANG,
    STARTS,
    FailingWalk,
    Shrinker,
    pair_of,
    rule_of,
)
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
from automcm_conformance.suite.suite_run import uncollected
from automcm_conformance.suite.tally import Fault
from automcm_conformance.suite.verdicts import failure, implementation
from automcm_spec.graph.oracle import Oracle, load
from automcm_spec.graph.oracle_generation import ONE_PEER, TIGHT, TWO_PEERS
from automcm_spec.graph.oracle_generation import spec_hash as present_hash
from automcm_spec.support import files
from automcm_spec.vocabulary.station import Cam, Command, Expire, Receive

GRAPHS = (ONE_PEER, TWO_PEERS, TIGHT)
BULK = 1_500
"""About this many lines are written before their answers are read."""
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
    """One walk; ``x`` is its exchange while it waits to be judged."""

    number: int
    coverage: WalkCoverage
    faults: Faults
    setting: Setting
    acts: list[Act]
    x: Exchange | None = None

    def id(self, seed: int) -> str:
        """The case id: seed and number determine the walk, the rest describes it."""
        times = "durations" if self.setting.timed else "natural"
        return f"EXPLORE/{seed}/{self.number}/{self.coverage.name}/{times}/{self.faults}"


class Explorer:
    """Walks against the adapter of a runner; replays and logs are written to ``folder``.

    The exploration ends after ``enough`` different failures.
    """

    def __init__(
        self, runner: Runner, oracles: dict[str, Oracle], folder: Path, seed: int, enough: int
    ) -> None:
        self.runner = runner
        self.seed = seed
        self._folder = folder
        self._enough = enough
        self.coverages = [
            WalkCoverage(
                name,
                o,
                [not runner.missing_feature(i) for i in o.inputs],
                bool(runner.limited_by(o)),
            )
            for name, o in oracles.items()
            if not runner.unfit(o)
        ]
        spec_hash = next(iter(oracles.values())).spec_hash
        self.found = Exploration(implementation(runner), seed, spec_hash)
        self._known: set[tuple[str, ...]] = set()
        self._last: list[Step] = []
        """The steps of the last attempt."""

    def run(self, more: Callable[[int], bool]) -> None:
        """Walk while ``more``, called with the number of walks, returns true."""
        waiting: list[Walk] = []
        lines, number = 0, 0
        while self._continues and more(number):
            number += 1
            new = self._walk(number)
            if new is not None:
                waiting.append(new)
                lines += len(new.x.unwritten_steps) if new.x is not None else 0
            if lines >= BULK or new is None:
                self._judge_all(waiting)
                waiting, lines = [], 0
                self.runner.notify(f"{self.found.walks:,} walks, {self.found.lines:,} lines")
        self._judge_all(waiting)
        if not self.coverages:
            self.found.problems.append("no graph has the fixed limits of the implementation")
        elif self.runner.cut_short:
            self.found.problems.append(self.runner.cut_short)

    @property
    def _continues(self) -> bool:
        return (
            bool(self.coverages)
            and not self.runner.cut_short
            and (len(self.found.cases) < self._enough)
        )

    # -- walks

    def _walk(self, number: int) -> Walk | None:
        """A new walk.  None if it has been judged at once, because it needed answers."""
        random = Random(f"{self.seed}/{number}")
        weights = [WEIGHTS[coverage.name] for coverage in self.coverages]
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
        x = new.x = self._exchange(new.coverage, setting)
        try:
            if timed:
                new.acts = walker.timed(length)
                walk(x, new.acts, setting)
            else:
                walker.natural(x, setting, length, new.acts)
                x.end_with_reset()
            if not x.begun:
                return new
            x.flush()
        except (Mismatch, Broken, Unpredicted) as error:
            self._judge(new, x, error)
        else:
            self._judge(new, x, None)
        return None

    def _exchange(
        self,
        coverage: WalkCoverage,
        setting: Setting,
        predict: bool | None = None,
        link: LineLink | None = None,
    ) -> Exchange:
        return self.runner.exchange(
            coverage.oracle,
            {**USUAL, **dict(setting.parameters)},
            rich=setting.rich,
            values=setting.values,
            predict=self.runner.predict if predict is None else predict,
            link=link,
        )

    def _judge_all(self, walks: Sequence[Walk]) -> None:
        """Judge the waiting walks.  After a failure the others are played again, because the
        station may be out of step."""
        remaining = list(walks)
        while remaining and self._continues:
            if not self.runner.predict:  # its lines depend on answers
                self._judge_alone(remaining.pop(0))
                continue
            exchanges = [each.x or self._play(each) for each in remaining]
            done, error = self._exchange_all(exchanges)
            for each, x in zip(remaining[:done], exchanges, strict=False):
                self._judge(each, x, None)
            if error is not None:
                self._judge(remaining[done], exchanges[done], error)
                done += 1
            remaining = remaining[done:]
            for each in remaining:
                each.x = None

    def _judge_alone(self, each: Walk) -> None:
        x = self._exchange(each.coverage, each.setting)
        try:
            walk(x, each.acts, each.setting)
            x.flush()
        except (Mismatch, Broken) as error:
            self._judge(each, x, error)
        else:
            self._judge(each, x, None)

    def _play(self, each: Walk) -> Exchange:
        x = self._exchange(each.coverage, each.setting)
        walk(x, each.acts, each.setting)
        return x

    def _exchange_all(
        self, exchanges: Sequence[Exchange]
    ) -> tuple[int, Wrong | Unpredicted | None]:
        """Send the lines of all exchanges; how many were right, and the error of the next."""
        broken: AdapterError | None = None
        try:
            answers = self.runner.adapter.exchange(
                [line for x in exchanges for line in x.unwritten_lines]
            )
        except AdapterError as error:
            answers, broken = error.answers, error
        for n, x in enumerate(exchanges):
            expected = len(x.unwritten_steps)
            own, answers = answers[:expected], answers[expected:]
            try:
                x.answered(own, broken if len(own) < expected else None)
            except (Mismatch, Broken, Unpredicted) as error:
                return n, error
        return len(exchanges), None

    # -- judging

    def _judge(self, each: Walk, x: Exchange, error: Wrong | Unpredicted | None) -> None:
        steps = x.done if error is None or isinstance(error, Unpredicted) else error.steps
        self.found.walks += 1
        self.found.lines += len(steps)
        for step in x.done:
            for pair in step.pairs:
                each.coverage.mark(pair, JUDGED)
        if isinstance(error, Unpredicted):
            self.runner.predict = False
        elif error is not None:
            self._handle_failure(each, error)

    def _handle_failure(self, each: Walk, error: Wrong) -> None:
        """Shorten and report a failing walk, unless an equal failure is known."""
        coverage, runner, adapter = each.coverage, self.runner, self.runner.adapter
        refused = isinstance(error, Broken) and isinstance(error.error, Refused)
        if not refused:  # a line too many or too few may have put the station out of step
            adapter.renew()
        signature = _signature(coverage.oracle, error)
        if signature in self._known:
            self.found.again += 1
            return
        self._known.add(signature)
        broken = adapter.broken, adapter.hung
        adapter.renew()  # a new process without memory
        again = self._attempt(each, each.setting, each.acts, None)
        if again is None:
            self._flaky(each, error, None)
            return
        self._known.add(_signature(coverage.oracle, again))
        rule = rule_of(coverage.oracle, again)
        shrinker = Shrinker(
            coverage,
            lambda setting, acts: self._attempt(each, setting, acts, rule),
            lambda setting, walks: self._first(each, setting, walks, rule),
            runner.timed,
            lambda: self._broken,
        )
        try:
            short = shrinker.shrink(FailingWalk(each.setting, each.acts, again))
            confirmed = self._confirm(each, short, rule)
        except KeyboardInterrupt:
            self._report(each, again, len(each.acts))
            raise
        adapter.broken, adapter.hung = broken  # repetitions do not count
        if confirmed is None:
            self._flaky(each, short.error, short)
            return
        self._known.add(_signature(coverage.oracle, confirmed))
        pair = pair_of(confirmed)
        if pair is not None:
            coverage.avoided.add(pair)
        self._report(each, confirmed, short.sent)

    @property
    def _broken(self) -> int:
        """Crashes; a hang counts as several."""
        return self.runner.adapter.broken + (HANG - 1) * self.runner.adapter.hung

    def _confirm(self, each: Walk, short: FailingWalk, rule: str) -> Wrong | None:
        """The failure in a new process, sent line by line as a replay is.

        None if the walk does not fail there, or not a second time in the same process: then the
        station keeps state over a reset.
        """
        self.runner.adapter.renew()
        error = self._attempt(each, short.setting, short.acts, rule, singly=True)
        if error is None or (isinstance(error, Broken) and error.kind == "hang"):
            return error
        again = self._attempt(each, short.setting, short.acts, rule)
        return None if again is None else error

    def _attempt(
        self,
        each: Walk,
        setting: Setting,
        acts: Sequence[Act],
        rule: str | None,
        *,
        singly: bool = False,
    ) -> Wrong | None:
        """Play one walk; returns its failure if that breaks ``rule`` (None: any rule)."""
        link = LineByLine(self.runner.adapter) if singly else None
        x = self._exchange(each.coverage, setting, predict=False, link=link)
        try:
            walk(x, acts, setting)
            x.flush()
        except (Mismatch, Broken) as error:
            self._last = error.steps
            self.runner.resynchronize(error)
            return error if rule in (None, rule_of(each.coverage.oracle, error)) else None
        self._last = x.done
        return None

    def _first(
        self, each: Walk, setting: Setting, walks: Sequence[Sequence[Act]], rule: str
    ) -> int | None:
        """The index of the first walk that breaks this rule, or None.  Sends many at once."""
        at, limit = 0, self._broken + STARTS
        while at < len(walks) and self._broken < limit:
            exchanges = self._unwritten(each.coverage, setting, walks[at:])
            if not exchanges:
                if self._attempt(each, setting, walks[at], rule) is not None:
                    return at
                at += 1
                continue
            n, error = self._exchange_all(exchanges)
            at += n
            if isinstance(error, Unpredicted):
                self.runner.predict = False
            elif error is not None:
                self.runner.resynchronize(error)
                if rule_of(each.coverage.oracle, error) == rule:
                    return at
                at += 1
        return None

    def _unwritten(
        self, coverage: WalkCoverage, setting: Setting, walks: Sequence[Sequence[Act]]
    ) -> list[Exchange]:
        """Exchanges for the first of these walks, up to one whose lines depend on answers."""
        exchanges: list[Exchange] = []
        for acts in walks if self.runner.predict else ():
            x = self._exchange(coverage, setting)
            try:
                walk(x, acts, setting)
            except (Mismatch, Broken, Unpredicted):
                break  # it is played alone
            if x.begun:
                break
            exchanges.append(x)
        return exchanges

    # -- reports

    def _flaky(self, each: Walk, error: Wrong, short: FailingWalk | None) -> None:
        """Report a failure that did not occur again with the same lines; keeps both logs."""
        sent = len(each.acts) if short is None else short.sent
        case = self._report(each, error, sent, again=False)
        number = len(self.found.cases)
        for name, steps in (("first", error.steps), ("again", self._last)):
            log = self._log(f"{number}-{name}", case.id, steps)
            case.reason += f"; {name}: {log}"

    def _log(self, name: str, case: str, steps: Sequence[Step]) -> str:
        """Write an exchange as a log, or as plain text if it has no form as a log."""
        if log := records.log_of(self._folder, name, case, steps, self.runner.adapter.hello):
            return log
        lines = (
            f"{line.now} {line.who}: {line.text}\n" for line in transcript.exchange(list(steps))
        )
        files.write(self._folder / "logs" / f"{name}.txt", "".join(lines))
        return f"logs/{name}.txt"

    def _report(self, each: Walk, error: Wrong, acts: int, *, again: bool = True) -> CaseResult:
        self.runner.adapter.renew()  # the last attempt may have left lines behind
        pair = pair_of(error)
        oracle = each.coverage.oracle
        rule = rule_of(oracle, error)
        unconfirmed = "" if again else NONDETERMINISTIC
        decided = Deciding(rule) if pair is None else deciding(oracle, error, pair)
        fault = Fault(error, decided, unconfirmed=unconfirmed)
        case = each.id(self.seed)
        described = failure(self.runner, case, 1, fault, self._folder)
        rules = [rule] if rule else []
        given = f"a walk over {each.coverage.name} with {each.faults}"
        result = CaseResult(
            case, fault.verdict, rules, "MUST", given, "", "", "", "", described.what
        )
        result.failures = [described]
        self.found.cases.append(result)
        self.found.acts[case] = acts
        return result


def _signature(oracle: Oracle, error: Wrong) -> tuple[str, ...]:
    """Equal failures have equal signatures: rule, kind of input, wrong parts of the answer."""
    pair = pair_of(error)
    value = None if pair is None else oracle.inputs[pair[1]]
    subject = ""
    match value:
        case Receive(message=message):
            subject = message.type
        case Cam(src=src):
            subject = str(src)
        case Expire(timer=timer):
            subject = timer[0]
        case Command(name=name):
            subject = name
    parts = error.parts if isinstance(error, Mismatch) else {error.kind}
    return rule_of(oracle, error), value.kind if value else "nothing", subject, *sorted(parts)


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
        oracles = {o.name: o for o in (load(graph.path, spec) for graph in GRAPHS)}
    adapter = Adapter(command, limit_s)
    explorer = Explorer(Runner(adapter, (), seed, notify), oracles, folder, seed, enough)
    found = explorer.found
    gc.freeze()  # keeps the graphs out of garbage collection
    try:
        explorer.run(more)
    except KeyboardInterrupt:
        found.problems.append("interrupted")
        adapter.renew()  # a partial line may have been written
    except OSError:
        raise
    except Exception as error:  # an internal error must not lose the results so far
        traceback.print_exc()
        found.broke = True
        found.problems.append(f"{BROKE}: {type(error).__name__}: {error}")
    finally:
        gc.unfreeze()
        adapter.stop()
    found.problems += adapter.problems
    found.coverage = {g.name: g.counts() for g in explorer.coverages}
    return found
