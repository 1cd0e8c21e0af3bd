"""Runs the suite: tours over the graphs, then the cases that no graph carries; verdicts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from automcm_conformance import records, scenarios, special
from automcm_conformance.adapter import PATIENCE, Adapter
from automcm_conformance.exchange import Broken, Exchange, Mismatch, Step, Unpredicted
from automcm_conformance.play import LEASES, RUNS, Wrong, play, shortened
from automcm_conformance.process import AdapterError
from automcm_conformance.purposes import Owners, Purpose
from automcm_conformance.results import Verdict
from automcm_conformance.tally import Fault, Part, Tally
from automcm_conformance.tour import Pair, Tours
from automcm_spec.oracle import Answer, Oracle, canonical

Json = Any
Say = Callable[[str], None]
PARAMETERS = {
    "t_timeout": 300,
    "t_resend": 100,
    "t_decide": 500,
    "t_cam_loss": 1500,
    "t_cam": 100,
    "backoff_min": 500,
    "backoff_max": 500,
}
"""What the graphs are driven with; the limits are those of the graph."""
LIMITS = {
    "max_rounds": "MaxRounds",
    "max_participants": "MaxParticipants",
    "outbox_limit": "OutboxLimit",
    "memory_limit": "MemoryLimit",
}
DIFFERENTLY = "nondeterministic: answered differently when the same was sent again"
BULK = 1_000
"""Lines that are written before their answers are read, about."""
ENOUGH = 3
"""Wrong answers after which a case is decided, and driven no further."""
ATTEMPTS = 3
"""Tours that may fail to reach a pair because time forbids it."""


@dataclass(slots=True)
class Flight:
    """A tour that is being played."""

    x: Exchange
    tour: list[int]
    lease: int
    off: Pair | None = None
    """What time forbids; the tour ends there."""


@dataclass(slots=True)
class Drive:
    """Tours over one part."""

    part: Part
    owners: Owners
    tours: Tours
    planned: int
    flights: list[Flight] = field(default_factory=list)
    attempts: Counter[Pair] = field(default_factory=Counter)

    @property
    def lines(self) -> int:
        """How many are waiting."""
        return sum(flight.x.unwritten for flight in self.flights)


class Runner:
    """One run of chosen purposes against one implementation."""

    def __init__(self, adapter: Adapter, purposes: Iterable[Purpose], seed: int, say: Say) -> None:
        self.adapter = adapter
        self.seed = seed
        self.say = say
        self.tallies = {purpose.id: Tally(purpose) for purpose in purposes}
        self.elsewhere: list[Fault] = []
        """Wrong answers of cases that are not run."""
        self.parts: list[Part] = []
        self.predict = True
        """The station numbers its sessions one by one, as far as is known."""
        self.features = frozenset[str](adapter.hello.features)
        self.fixed: dict[str, int] = {str(k): v for k, v in adapter.hello.fixed.items()}

    @property
    def timed(self) -> bool:
        """The kit says how long timers last."""
        return "durations" in self.features

    @property
    def cut_short(self) -> bool:
        """It crashes or hangs all the time."""
        return self.adapter.broken >= PATIENCE

    def exchange(
        self,
        oracle: Oracle,
        parameters: Mapping[str, int] = PARAMETERS,
        *,
        rich: bool = False,
        seed: int | None = None,
        predict: bool = False,
        logged: bool = True,
    ) -> Exchange:
        """A fresh station, with the limits of the graph."""
        limits = {name: oracle.constants[constant] for name, constant in LIMITS.items()}
        given = {**parameters, **limits, **self.fixed}
        scenario = self.adapter.hello.scenarios[0]
        return Exchange(
            oracle,
            self.adapter,
            given,
            scenario=scenario,
            seed=self.seed if seed is None else seed,
            rich=rich,
            predict=predict,
            logged=logged,
        )

    # -- which pairs

    def graph(self, part: Part, answers: Iterable[Answer], owners: Owners) -> None:
        """Drive these pairs of a graph."""
        self.tour(self.plan(part, answers, owners))

    def plan(self, part: Part, answers: Iterable[Answer], owners: Owners) -> Drive:
        """Which of these pairs are to be driven; the others are counted as skipped."""
        self.parts.append(part)
        oracle = part.oracle
        unfit = self._unfit(oracle)
        left_out = [self._left_out(value) for value in oracle.inputs]
        targets = []
        for answer in answers:
            tally = self._tally(part, owners, answer)
            if tally is None:
                continue
            part.totals["transitions" if answer.changes else "refusals"] += 1
            tally.total += 1
            why = unfit or left_out[answer.input] or self._limited(oracle, answer)
            if why:
                tally.skipped[why] += 1
            else:
                targets.append((answer, tally.purpose.id))
        tours = part.tours = Tours.over(oracle, targets, lambda s, i: not left_out[i])
        for state in [state for state in tours.left if tours.path(state) is None]:
            for i in list(tours.left[state]):
                self.tallies[tours.left[state][i]].skipped["a feature that leads there"] += 1
                tours.done((state, i))
        return Drive(part, owners, tours, len(targets))

    def tour(self, drive: Drive) -> None:
        """Drive what is planned, as far as it goes."""
        part, tours = drive.part, drive.tours
        while not self.cut_short:
            tour = tours.next()
            if tour is None and not drive.flights:
                break
            if tour is not None:
                self._start(drive, tour)
            if tour is None or drive.lines >= BULK:
                self.say(f"{part.name}: {part.reached.total():,} of {drive.planned:,}")
                self._land(drive)
        tours.usable(drive.attempts)
        for state in [state for state in tours.left if tours.path(state) is not None]:
            for i in list(tours.left[state]):
                self._forbidden(part, tours.done((state, i)))

    def _tally(self, part: Part, owners: Owners, answer: Answer) -> Tally | None:
        """The case that a pair belongs to, if it is run."""
        state, i = part.oracle.states[answer.state], part.oracle.inputs[answer.input]
        owner = owners.owner(state, i, answer.effect, answer.changes, part.third)
        return None if owner is None else self.tallies.get(owner.id)

    def _unfit(self, oracle: Oracle) -> str:
        """Why this graph says nothing about the implementation; empty if it does."""
        rounds = oracle.constants["MaxRounds"]
        if self.fixed.get("max_rounds", rounds) != rounds:
            return f"max_rounds is fixed; the graph has {rounds}"
        return ""

    def _left_out(self, value: Json) -> str:
        """The feature that an input needs and the implementation does not have."""
        match value[0]:
            case "restart":
                needed = "restart"
            case "command":
                needed = "receiver" if value[1] in ("accept", "refuse") else "prescriber"
                if value[1] == "abort":
                    return ""
            case "receive" if value[1][0] == "Advertisement" and value[2]:
                needed = "receiver"
            case _:
                return ""
        return "" if needed in self.features else needed

    def _limited(self, oracle: Oracle, answer: Answer) -> str:
        """MEM-1 can be seen only with the limits of the graph."""
        if answer.effect.rule != "MEM-1":
            return ""
        other = [
            n for n, c in LIMITS.items() if self.fixed.get(n, 0) not in (0, oracle.constants[c])
        ]
        return f"{other[0]} is fixed" if other else ""

    # -- cases that no graph carries, and one exchange of each case

    def special(self, purpose: Purpose, part: Part, folder: Path) -> None:
        """Run a case by its name."""
        tally = self.tallies[purpose.id]
        tally.total = 1
        missing = special.needs(purpose.case) - self.features
        if missing or self.cut_short:
            tally.skipped.update(sorted(missing)[:1])
            return
        fresh = partial(self.exchange, part.oracle)
        steps: list[Step] = []
        count = 0
        try:
            for x in special.exchanges(purpose.case, fresh):
                count += 1
                steps = steps or x.done
        except (Mismatch, Broken) as error:
            steps = error.steps
            tally.faults.append(self._fault(part, steps[-1].pairs, error, str(error), purpose))
        tally.total = tally.reached = count + len(tally.faults)
        tally.log = self._log(folder, purpose.id, steps)

    def scenario(self, purpose: Purpose, folder: Path) -> None:
        """Run a scenario: several stations, each behind a process of its own."""
        tally = self.tallies[purpose.id]
        tally.total = 1
        if self.cut_short:
            return
        adapter = self.adapter
        outcome = tally.outcome = scenarios.run(
            purpose.case,
            adapter.command,
            adapter.hello,
            folder,
            limit_s=adapter.limit_s,
            seed=self.seed,
        )
        tally.log = outcome.log[0] if outcome.log else ""
        tally.reached = 0 if outcome.verdict == "SKIP" else 1

    def samples(self, folder: Path) -> None:
        """One exchange of each case of a graph, twice: for its log, and because the same lines
        must bring the same answers."""
        for name, tally in self.tallies.items():
            if tally.faults:
                tally.log = self._log(folder, name, tally.faults[0].steps)
            elif tally.sample is not None and not self.cut_short:
                self.say(f"log: {name}")
                self._sample(tally, *tally.sample, folder)

    def _sample(self, tally: Tally, part: Part, pair: Pair, folder: Path) -> None:
        way = part.tours.path(pair[0]) if part.tours is not None else None
        if way is None:
            return
        runs = []
        for _ in range(2):
            x = self.exchange(part.oracle)
            try:
                play(x, [*way, pair[1]], self.timed)
                x.flush()
            except (Mismatch, Broken) as error:
                what = f"{DIFFERENTLY}: {error}"
                tally.faults.append(self._fault(part, [pair], error, what, tally.purpose, "ERROR"))
                return
            runs.append(x.done)
        tally.log = self._log(folder, tally.purpose.id, runs[0])
        for one, other in zip(*runs, strict=True):
            if one.answer != other.answer:
                what = f"{DIFFERENTLY}: {other.answer[:200]!r}, before {one.answer[:200]!r}"
                differs = Mismatch(runs[1], [("answer", what)])
                fault = self._fault(part, [pair], differs, what, tally.purpose, "ERROR")
                tally.faults.append(fault)
                return

    def _log(self, folder: Path, case: str, steps: list[Step]) -> str:
        """Write the log of an exchange; returns its path in the folder, or nothing if an answer
        of it cannot be told in a log."""
        path = folder / "logs" / f"{case.replace('/', '-')}.ndjson"
        path.parent.mkdir(parents=True, exist_ok=True)
        hello = self.adapter.hello
        try:
            records.write_log(path, case, steps, hello.name, hello.version)
        except (ValueError, TypeError, KeyError):
            path.unlink(missing_ok=True)
            return ""
        return str(path.relative_to(folder))

    # -- driving them

    def _start(self, drive: Drive, tour: list[int]) -> None:
        """Another tour.  Its lines are written with those of others, if they need no answer."""
        lease = LEASES[drive.attempts.total() % len(LEASES)]
        x = self.exchange(drive.part.oracle, predict=self.predict, logged=False)
        flight = Flight(x, tour, lease)
        try:
            flight.off = play(x, tour, self.timed, lease)
            if x.begun:
                x.flush()
        except (Mismatch, Broken, Unpredicted) as error:
            self._landed(drive, flight, error)
            return
        if x.begun:
            self._landed(drive, flight)
        else:
            drive.flights.append(flight)

    def _land(self, drive: Drive) -> None:
        """Write what is waiting in all tours, and judge each."""
        flights, drive.flights = drive.flights, []
        broken: AdapterError | None = None
        try:
            answers = self.adapter.exchange([line for f in flights for line in f.x.waiting])
        except AdapterError as error:
            answers, broken = error.answers, error
        drive.tours.planned.clear()
        for flight in flights:
            asked = flight.x.unwritten
            mine, answers = answers[:asked], answers[asked:]
            try:
                flight.x.answered(mine, broken if len(mine) < asked else None)
            except (Mismatch, Broken, Unpredicted) as wrong:
                self._landed(drive, flight, wrong)
            else:
                self._landed(drive, flight)
            if len(mine) < asked:
                break  # the tours behind it were not played

    def _landed(
        self, drive: Drive, flight: Flight, error: Wrong | Unpredicted | None = None
    ) -> None:
        """A tour has been judged.  What is answered wrongly is confirmed, blamed on a case, and
        avoided."""
        tours, x = drive.tours, flight.x
        self._credit(drive.part, tours, x.done)
        if error is not None:
            tours.planned.clear()
        if isinstance(error, Unpredicted):
            self.predict = False
        elif error is not None:
            self._wrong(drive.part, drive.owners, tours, flight.tour, error, flight.lease)
        elif flight.off is not None:
            drive.attempts[flight.off] += 1
            if drive.attempts[flight.off] >= ATTEMPTS:
                self._forbidden(drive.part, tours.avoid(flight.off))

    def _forbidden(self, part: Part, case: str | None) -> None:
        """Time does not allow a pair of this case."""
        if case is not None:
            part.forbidden += 1
            self.tallies[case].forbidden += 1

    def _credit(self, part: Part, tours: Tours, steps: Iterable[Step]) -> None:
        for step in steps:
            for pair in step.pairs:
                case = tours.done(pair)
                if case is not None:
                    self._reached(part, case, pair)

    def _reached(self, part: Part, case: str, pair: Pair) -> None:
        tally = self.tallies[case]
        tally.reached += 1
        changes = part.oracle.is_move(*pair)
        part.reached["transitions" if changes else "refusals"] += 1
        tally.sample = tally.sample or (part, pair)

    # -- wrong answers

    def _wrong(
        self,
        part: Part,
        owners: Owners,
        tours: Tours,
        tour: list[int],
        error: Wrong,
        lease: int,
    ) -> None:
        """Find the shortest exchange that goes wrong so, and the case that it belongs to."""
        place = error.steps[-1].place
        inputs = tour[: place + 1]
        states = _states(part.oracle, inputs)
        seen: Pair = (states[place], tour[place])
        answer = part.oracle.answer(*seen)
        assert answer is not None
        decided = self._tally(part, owners, answer)
        if decided is not None and len(decided.faults) >= ENOUGH:
            tours.avoid(seen)
            return

        def attempt(again: list[int]) -> Wrong | None:
            if self.cut_short:
                return None
            x = self.exchange(part.oracle)
            try:
                play(x, again, self.timed, lease)
                x.flush()
            except (Mismatch, Broken) as wrong:
                return wrong
            return None

        hangs = isinstance(error, Broken) and getattr(error.error, "kind", "") == "hang"
        ways = [tours.path(state) for state in states]
        short = shortened(part.oracle, inputs, ways, attempt, 1 if hangs else RUNS)
        if short is None:
            case = tours.avoid(seen)
            if hangs:
                self._blame(part, owners, tours, seen, error, str(error))
            else:
                what = f"{DIFFERENTLY}: {error}"
                self._blame(part, owners, tours, seen, error, what, "ERROR")
            if case is not None:
                self._reached(part, case, seen)
            return
        inputs, error = short
        culprit, why = self._culprit(part, inputs, error)
        if culprit in tours.avoided:
            culprit = seen  # so that each wrong answer takes away something to do
        case = tours.avoid(culprit)
        if case is not None:
            self._reached(part, case, culprit)
        self._blame(part, owners, tours, culprit, error, f"{error}{why}")

    def _culprit(self, part: Part, inputs: list[int], error: Wrong) -> tuple[Pair, str]:
        """The pair to blame for a shortest wrong exchange, and why it if is not the last one."""
        oracle, step = part.oracle, error.steps[-1]
        states = _states(oracle, inputs)
        last = states[-1], inputs[-1]
        for state, i in zip(reversed(states[:-1]), reversed(inputs[:-1]), strict=True):
            answer = oracle.answer(state, i)
            assert answer is not None
            if not answer.changes:
                return (state, i), "; an input before it, which must change nothing, changed that"
        if isinstance(error, Mismatch) and {part for part, _ in error.problems} == {"deadline"}:
            found = error.found_deadline
            wanted = step.expected.deadline
            timer = oracle.input_index.get(canonical(["expire", step.next_timer]))
            late = wanted is not None and (found is None or found > wanted)
            if late and timer is not None and oracle.answer(step.after, timer) is not None:
                name = step.next_timer[0]
                return (step.after, timer), f"; the timer {name} is not armed, or lasts too long"
        return last, ""

    def _blame(
        self,
        part: Part,
        owners: Owners,
        tours: Tours,
        pair: Pair,
        error: Wrong,
        what: str,
        verdict: Verdict | None = None,
    ) -> None:
        answer = part.oracle.answer(*pair)
        assert answer is not None
        tally = self._tally(part, owners, answer)
        if isinstance(error, Mismatch) and {p for p, _ in error.problems} == {"cams"}:
            marks = (t for t in self.tallies.values() if t.purpose.case == "cam marks")
            tally = next(marks, tally)
        purpose = tally.purpose if tally else None
        fault = self._fault(part, [pair], error, what, purpose, verdict)
        if tally is None:
            self.elsewhere.append(fault)
            return
        tally.faults.append(fault)
        if len(tally.faults) >= ENOUGH:
            tours.drop(tally.purpose.id)

    def _fault(
        self,
        part: Part,
        pairs: list[Pair],
        error: Wrong,
        what: str,
        purpose: Purpose | None,
        verdict: Verdict | None = None,
    ) -> Fault:
        """A fault; its rule is that of the last pair, or of the case."""
        rule = purpose.rules[0] if purpose else ""
        value: Json = None
        if pairs:
            answer = part.oracle.answer(*pairs[-1])
            value = part.oracle.inputs[pairs[-1][1]]
            rule = answer.effect.rule if answer else rule
        return Fault(
            verdict or ("FAIL" if isinstance(error, Mismatch) else "ERROR"),
            part,
            error.steps,
            rule,
            value,
            what,
            list(getattr(getattr(error, "error", None), "stderr", ())),
        )


def _states(oracle: Oracle, inputs: Sequence[int]) -> list[int]:
    """The state before each input."""
    states = [0]
    for i in inputs[:-1]:
        answer = oracle.answer(states[-1], i)
        assert answer is not None
        states.append(answer.next)
    return states
