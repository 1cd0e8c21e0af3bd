"""Exploration: walks over the graphs against one implementation, with the oracle as judge, until
time is up; what goes wrong is shortened on the implementation itself.

Walks steer to what has not been given yet.  All of a walk follows from the seed and its number:
only how many walks there are depends on the time.
"""

from __future__ import annotations

import gc
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from automcm_conformance.adapter.adapter import Adapter, Singly
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import Refused
from automcm_conformance.exchange import records, transcript
from automcm_conformance.exchange.exchange import (
    Broken,
    Exchange,
    Link,
    Mismatch,
    Step,
    Unpredicted,
)
from automcm_conformance.exchange.play import Wrong
from automcm_conformance.exchange.results import BROKE, CaseResult, Exploration
from automcm_conformance.exchange.wire import LONG, LONG_MS, VALUES
from automcm_conformance.explore.walk_shrinking import (
    HANG,
    STARTS,
    Short,
    Shrinker,
    pair_of,
    rule_of,
)
from automcm_conformance.explore.walks import JUDGED, Act, Coverage, Faults, Setting, Walker, walk
from automcm_conformance.suite.graph_cases import PARAMETERS as USUAL
from automcm_conformance.suite.graph_cases import Runner, Say
from automcm_conformance.suite.suite_run import uncollected
from automcm_conformance.suite.tally import Fault, finding
from automcm_conformance.suite.verdicts import failure, implementation
from automcm_spec.graph.oracle import Oracle, load
from automcm_spec.graph.oracle_generation import ONE_PEER, TIGHT, TWO_PEERS
from automcm_spec.graph.oracle_generation import spec_hash as present_hash
from automcm_spec.support import files
from automcm_spec.vocabulary.station import Cam, Command, Expire, Receive

GRAPHS = (ONE_PEER, TWO_PEERS, TIGHT)
BULK = 1_500
"""Lines that are written before their answers are read, about."""
LENGTHS = (20, 60, 120)
"""Acts in a walk."""
WEIGHTS = {"one-peer": 3, "two-peers": 5, "tight": 1}
PARAMETERS: tuple[tuple[tuple[str, int], ...], ...] = (
    (),
    (("t_timeout", 0), ("t_cam_loss", 1001)),
    (("t_timeout", 1000), ("t_decide", 170)),
    (("t_timeout", 250), ("t_resend", 60), ("t_decide", 2500), ("t_cam_loss", 3000)),
)
"""Parameters of walks in natural time, besides those of the suite."""
LEASES_MS = (300, 1_700, 9_000, LONG_MS)


@dataclass(slots=True)
class Walk:
    """One of them; ``x`` is its exchange, if it waits to be judged."""

    number: int
    coverage: Coverage
    faults: Faults
    setting: Setting
    acts: list[Act]
    x: Exchange | None = None

    def id(self, seed: int) -> str:
        """The case: seed and number make the walk, the rest says what it is."""
        times = "durations" if self.setting.timed else "natural"
        return f"EXPLORE/{seed}/{self.number}/{self.coverage.name}/{times}/{self.faults}"


class Explorer:
    """Walks against the adapter of a runner; replays and logs are written into ``folder``.

    ``enough``: different failures after which it ends.
    """

    def __init__(
        self, runner: Runner, oracles: dict[str, Oracle], folder: Path, seed: int, enough: int
    ) -> None:
        self.runner = runner
        self.seed = seed
        self._folder = folder
        self._enough = enough
        self.coverages = [
            Coverage(
                name, o, [not runner.left_out(i) for i in o.inputs], bool(runner.limited_by(o))
            )
            for name, o in oracles.items()
            if not runner.unfit(o)
        ]
        spec_hash = next(iter(oracles.values())).spec_hash
        self.found = Exploration(implementation(runner), seed, spec_hash)
        self._known: set[tuple[str, ...]] = set()
        self._last: list[Step] = []
        """What was said in the last walk that went well."""

    def run(self, more: Callable[[int], bool]) -> None:
        """Walk as long as ``more`` says so of the number of walks."""
        waiting: list[Walk] = []
        lines, number = 0, 0
        while self._goes_on and more(number):
            number += 1
            new = self._walk(number)
            if new is not None:
                waiting.append(new)
                lines += new.x.unwritten if new.x is not None else 0
            if lines >= BULK or new is None:
                self._land(waiting)
                waiting, lines = [], 0
                self.runner.say(f"{self.found.walks:,} walks, {self.found.lines:,} lines")
        self._land(waiting)
        if not self.coverages:
            self.found.problems.append("no graph has the limits that are fixed")
        elif self.runner.cut_short:
            self.found.problems.append(self.runner.cut_short)

    @property
    def _goes_on(self) -> bool:
        return (
            bool(self.coverages)
            and not self.runner.cut_short
            and (len(self.found.cases) < self._enough)
        )

    # -- walks

    def _walk(self, number: int) -> Walk | None:
        """Another one.  None if it has been judged already, because it could not wait."""
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
                x.seal()
            if not x.begun:
                return new
            x.flush()
        except (Mismatch, Broken, Unpredicted) as error:
            self._landed(new, x, error)
        else:
            self._landed(new, x, None)
        return None

    def _exchange(
        self,
        coverage: Coverage,
        setting: Setting,
        predict: bool | None = None,
        link: Link | None = None,
    ) -> Exchange:
        return self.runner.exchange(
            coverage.oracle,
            {**USUAL, **dict(setting.parameters)},
            rich=setting.rich,
            values=setting.values,
            predict=self.runner.predict if predict is None else predict,
            link=link,
        )

    def _land(self, walks: Sequence[Walk]) -> None:
        """Judge what is waiting.  After a wrong answer the rest is played again: it may be out of
        step."""
        left = list(walks)
        while left and self._goes_on:
            if not self.runner.predict:  # it is written in parts, and cannot wait
                self._land_one(left.pop(0))
                continue
            exchanges = [each.x or self._played(each) for each in left]
            done, error = self._together(exchanges)
            for each, x in zip(left[:done], exchanges, strict=False):
                self._landed(each, x, None)
            if error is not None:
                self._landed(left[done], exchanges[done], error)
                done += 1
            left = left[done:]
            for each in left:
                each.x = None

    def _land_one(self, each: Walk) -> None:
        x = self._exchange(each.coverage, each.setting)
        try:
            walk(x, each.acts, each.setting)
            x.flush()
        except (Mismatch, Broken) as error:
            self._landed(each, x, error)
        else:
            self._landed(each, x, None)

    def _played(self, each: Walk) -> Exchange:
        x = self._exchange(each.coverage, each.setting)
        walk(x, each.acts, each.setting)
        return x

    def _together(self, exchanges: Sequence[Exchange]) -> tuple[int, Wrong | Unpredicted | None]:
        """Write what waits in all of them and judge: how many were right, and what was wrong."""
        broken: AdapterError | None = None
        try:
            answers = self.runner.adapter.exchange([line for x in exchanges for line in x.waiting])
        except AdapterError as error:
            answers, broken = error.answers, error
        for n, x in enumerate(exchanges):
            asked = x.unwritten
            mine, answers = answers[:asked], answers[asked:]
            try:
                x.answered(mine, broken if len(mine) < asked else None)
            except (Mismatch, Broken, Unpredicted) as error:
                return n, error
        return len(exchanges), None

    # -- what came of them

    def _landed(self, each: Walk, x: Exchange, error: Wrong | Unpredicted | None) -> None:
        steps = x.done if error is None or isinstance(error, Unpredicted) else error.steps
        self.found.walks += 1
        self.found.lines += len(steps)
        for step in x.done:
            for pair in step.pairs:
                each.coverage.mark(pair, JUDGED)
        if isinstance(error, Unpredicted):
            self.runner.predict = False
        elif error is not None:
            self._wrong(each, error)

    def _wrong(self, each: Walk, error: Wrong) -> None:
        """Shorten it, unless it is known."""
        coverage, runner, adapter = each.coverage, self.runner, self.runner.adapter
        refused = isinstance(error, Broken) and isinstance(error.error, Refused)
        if not refused:  # else a line more or less may have put it out of step
            adapter.renew()
        mark = _mark(coverage.oracle, error)
        if mark in self._known:
            self.found.again += 1
            return
        self._known.add(mark)
        broken = adapter.broken, adapter.hung
        adapter.renew()  # which remembers nothing
        again = self._attempt(each, each.setting, each.acts, None)
        if again is None:
            self._flaky(each, error, None)
            return
        self._known.add(_mark(coverage.oracle, again))
        rule = rule_of(coverage.oracle, again)
        shrinker = Shrinker(
            coverage,
            lambda setting, acts: self._attempt(each, setting, acts, rule),
            lambda setting, walks: self._first(each, setting, walks, rule),
            runner.timed,
            lambda: self._broken,
        )
        try:
            short = shrinker.shrink(Short(each.setting, each.acts, again))
            sure = self._confirmed(each, short, rule)
        except KeyboardInterrupt:
            self._report(each, again, len(each.acts))
            raise
        adapter.broken, adapter.hung = broken  # it counts once, however often it is tried again
        if sure is None:
            self._flaky(each, short.error, short)
            return
        self._known.add(_mark(coverage.oracle, sure))
        pair = pair_of(sure)
        if pair is not None:
            coverage.avoided.add(pair)
        self._report(each, sure, short.sent)

    @property
    def _broken(self) -> int:
        """Crashes; a hang counts as several."""
        return self.runner.adapter.broken + (HANG - 1) * self.runner.adapter.hung

    def _confirmed(self, each: Walk, short: Short, rule: str) -> Wrong | None:
        """What goes wrong in a fresh process, line by line, as a replay is sent; None if nothing
        does, there or once more in the same process: the station remembers more than it may."""
        self.runner.adapter.renew()
        sure = self._attempt(each, short.setting, short.acts, rule, singly=True)
        if sure is None or (isinstance(sure, Broken) and sure.kind == "hang"):
            return sure
        again = self._attempt(each, short.setting, short.acts, rule)
        return None if again is None else sure

    def _attempt(
        self,
        each: Walk,
        setting: Setting,
        acts: Sequence[Act],
        rule: str | None,
        *,
        singly: bool = False,
    ) -> Wrong | None:
        """Play a walk alone; what went wrong, if it breaks this rule (or any, if it is None)."""
        link = Singly(self.runner.adapter) if singly else None
        x = self._exchange(each.coverage, setting, predict=False, link=link)
        try:
            walk(x, acts, setting)
            x.flush()
        except (Mismatch, Broken) as error:
            self._last = error.steps
            self.runner.in_step(error)
            return error if rule in (None, rule_of(each.coverage.oracle, error)) else None
        self._last = x.done
        return None

    def _first(
        self, each: Walk, setting: Setting, walks: Sequence[Sequence[Act]], rule: str
    ) -> int | None:
        """The first of some walks that breaks this rule, as far as they can be played together."""
        at, most = 0, self._broken + STARTS
        while at < len(walks) and self._broken < most:
            exchanges = self._unwritten(each.coverage, setting, walks[at:])
            if not exchanges:
                if self._attempt(each, setting, walks[at], rule) is not None:
                    return at
                at += 1
                continue
            n, error = self._together(exchanges)
            at += n
            if isinstance(error, Unpredicted):
                self.runner.predict = False
            elif error is not None:
                self.runner.in_step(error)
                if rule_of(each.coverage.oracle, error) == rule:
                    return at
                at += 1
        return None

    def _unwritten(
        self, coverage: Coverage, setting: Setting, walks: Sequence[Sequence[Act]]
    ) -> list[Exchange]:
        """Of these walks the first ones, as many as need no answer on the way."""
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

    def _flaky(self, each: Walk, error: Wrong, short: Short | None) -> None:
        """It went wrong, and did not when the same was sent again: both logs are kept."""
        sent = len(each.acts) if short is None else short.sent
        case = self._report(each, error, sent, again=False)
        number = len(self.found.cases)
        for name, steps in (("first", error.steps), ("again", self._last)):
            log = self._log(f"{number}-{name}", case.id, steps)
            case.reason += f"; {name}: {log}"

    def _log(self, name: str, case: str, steps: Sequence[Step]) -> str:
        """Write an exchange as a log; as lines of text where it cannot be told in one."""
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
        rule, value = rule_of(oracle, error), None if pair is None else oracle.inputs[pair[1]]
        fault = Fault(finding(error, rule, again=again), value, error)
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


def _mark(oracle: Oracle, error: Wrong) -> tuple[str, ...]:
    """By what failures are told apart: rule, kind of input, what of the answer is wrong."""
    pair = pair_of(error)
    value = None if pair is None else oracle.inputs[pair[1]]
    about = ""
    match value:
        case Receive(message=message):
            about = message.type
        case Cam(src=src):
            about = str(src)
        case Expire(timer=timer):
            about = timer[0]
        case Command(name=name):
            about = name
    parts = {part for part, _ in error.problems} if isinstance(error, Mismatch) else {error.kind}
    return rule_of(oracle, error), value.kind if value else "nothing", about, *sorted(parts)


def explore(
    command: Sequence[str],
    folder: Path,
    *,
    limit_s: float,
    seed: int,
    enough: int,
    say: Say,
    more: Callable[[int], bool],
) -> Exploration:
    """Walk against the adapter that ``command`` starts, as long as ``more`` says so.

    Raises AdapterError or ProtocolError if the adapter does not even say hello, and OracleError.
    What was found before a fault of the kit or an interruption is returned.
    """
    spec = present_hash()
    with uncollected():
        oracles = {o.name: o for o in (load(graph.path, spec) for graph in GRAPHS)}
    adapter = Adapter(command, limit_s)
    explorer = Explorer(Runner(adapter, (), seed, say), oracles, folder, seed, enough)
    found = explorer.found
    gc.freeze()  # the collector need not look at the graphs again and again
    try:
        explorer.run(more)
    except KeyboardInterrupt:
        found.problems.append("interrupted")
        adapter.renew()  # half a line may have been written: how it ends now says nothing
    except OSError:
        raise
    except Exception as error:  # a fault of ours must not cost what was found so far
        traceback.print_exc()
        found.broke = True
        found.problems.append(f"{BROKE}: {type(error).__name__}: {error}")
    finally:
        gc.unfreeze()
        adapter.stop()
    found.problems += adapter.problems
    found.coverage = {g.name: g.counts() for g in explorer.coverages}
    return found
