"""Runs the cases that graphs carry: plans tours, plays them, and blames wrong answers on cases."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from time import monotonic

from automcm_conformance.adapter.adapter import PATIENCE, Adapter, LineByLine
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import DEFAULTS, NEEDS, ProtocolError, Refused
from automcm_conformance.exchange.answers import BACK_OFF, MARKS
from automcm_conformance.exchange.confirmation import in_fresh_process
from automcm_conformance.exchange.deciding import deciding, deciding_pair
from automcm_conformance.exchange.exchange import (
    Broken,
    Exchange,
    LineLink,
    Mismatch,
    Unpredicted,
    Wrong,
)
from automcm_conformance.exchange.play import LEASES, RUNS, play, shortened
from automcm_conformance.exchange.results import CUT_SHORT, KEPT, NONDETERMINISTIC, Deciding
from automcm_conformance.exchange.tours import Allowed, Pair, Tours
from automcm_conformance.exchange.wire import LONG, PLAIN, VALUES, Values
from automcm_conformance.suite.purposes import Owners, Purpose
from automcm_conformance.suite.tally import (
    ENOUGH,
    WHOLE,
    PairPart,
    Tally,
    TourInProgress,
)
from automcm_spec.graph.oracle import Oracle, OracleAnswer
from automcm_spec.vocabulary.parameters import LIMITS
from automcm_spec.vocabulary.rules import operators
from automcm_spec.vocabulary.station import Command, Input, Message, Receive, Restart

Notify = Callable[[str], None]
PARAMETERS = DEFAULTS | {"t_timeout": 300, "backoff_max": DEFAULTS["backoff_min"]}
"""The parameters for the graphs; the limits are those of the graph."""
BULK = 1_000
"""The approximate number of lines that are written before their answers are read."""
STARTS = 20
"""Exchanges tried in order to shorten one that ends in a crash: each needs a new process."""
HANGS = 3
"""After so many hangs at the same command, the rest of a part is skipped."""
CRASHES = ("crash", "closed")
FIRST, SHARES = 30, {False: 35, True: 5}
"""``--quick`` drives the first pairs of a case, and one in so many of the others, by whether they
change something."""
NEAR = 4
"""An exchange with more inputs is compared with the shortest way to its last one."""
ATTEMPTS = 3
"""Tours that may fail to reach a pair because time does not allow it."""


class Runner:
    """One run of chosen purposes against one implementation."""

    def __init__(
        self, adapter: Adapter, purposes: Iterable[Purpose], seed: int, notify: Notify
    ) -> None:
        self.adapter = adapter
        self.seed = seed
        self._notify = notify
        self.tallies = {purpose.id: Tally(purpose) for purpose in purposes}
        chosen = (tally.purpose.select for tally in self.tallies.values())
        self.rules = frozenset[str]().union(*(select["rule"] for select in chosen if select))
        """The rules that decide the pairs of the chosen cases."""
        self.elsewhere: Wrong | None = None
        """The first wrong answer of a case that is not part of the run."""
        marks = (t for t in self.tallies.values() if t.purpose.case == "cam marks")
        self._cam_marks = next(marks, None)
        """The case that is blamed for wrong marks, wherever they occur."""
        self._hangs = Counter[tuple[str, str]]()
        """How often the station hung in a part, by the command."""
        self.stuck = set[str]()
        """The parts whose rest is skipped because the station hangs."""
        self.parts: list[PairPart] = []
        self.notes: list[str] = []
        """What no verdict says."""
        self.ended = ""
        """Why the run was ended from outside, or by a fault of the kit."""
        self.broke = False
        self.enough = 0
        """The number of failed cases that ends the run; 0: none."""
        self.quick = False
        """Only some pairs of each case are driven; cases of two peers and scenarios are omitted."""
        self.case_seconds: dict[str, float] = {}
        """The real time of each case."""
        self.predict = True
        """The station is assumed to number its sessions one by one."""
        self.features = frozenset[str](adapter.hello.features)
        self.fixed = adapter.hello.fixed

    def notify(self, text: str) -> None:
        """Show the progress, and a hint if the adapter is slow."""
        hint = self.adapter.slowness
        self._notify(f"{text}; {hint}" if hint else text)

    @property
    def timed(self) -> bool:
        """Whether the kit sets the durations of timers."""
        return "durations" in self.features

    @property
    def cut_short(self) -> str:
        """Why nothing more is driven; empty if the run goes on."""
        if self.adapter.broken >= PATIENCE:
            return f"{CUT_SHORT} after {self.adapter.broken} crashes or hangs"
        if self.has_enough:
            n = len(self.failed)
            return f"{CUT_SHORT} after {n} failed case{'' if n == 1 else 's'}, as --stop-after says"
        return self.ended

    @property
    def has_enough(self) -> bool:
        """Whether so many cases have failed that the run ends."""
        return bool(self.enough) and len(self.failed) >= self.enough

    @property
    def failed(self) -> list[str]:
        """The cases that are already FAIL or ERROR, in their order."""
        return [name for name, tally in self.tallies.items() if tally.failed]

    def exchange(
        self,
        oracle: Oracle,
        parameters: Mapping[str, int] = PARAMETERS,
        *,
        rich: bool = False,
        values: Values = PLAIN,
        seed: int | None = None,
        predict: bool = False,
        logged: bool = True,
        limits: Mapping[str, int] | None = None,
        link: LineLink | None = None,
    ) -> Exchange:
        """An exchange with a fresh station over the adapter or another ``link``, by default with
        the limits of the graph. Parameters that need a missing feature are omitted."""
        limits = limits or {n: oracle.constants[constant] for n, constant in LIMITS.items()}
        hello = self.adapter.hello
        return Exchange(
            oracle,
            link or self.adapter,
            hello.fitted({**parameters, **limits}),
            scenario=hello.scenarios[0],
            judges_marks="cam" in self.features
            and not (self._cam_marks and self._cam_marks.decided),
            rich=rich,
            values=values,
            seed=self.seed if seed is None else seed,
            predict=predict,
            logged=logged,
        )

    # -- which pairs

    def graph(self, part: PairPart, answers: Iterable[OracleAnswer], owners: Owners) -> None:
        """Test these pairs of a graph. Their time is shared by the cases they belong to."""
        before = {name: tally.reached for name, tally in self.tallies.items()}
        started = monotonic()
        self.plan(part, answers, owners)
        self.tour(part)
        part.tours.end()
        driven = {n: tally.reached - before[n] for n, tally in self.tallies.items()}
        each = (monotonic() - started) / max(1, sum(driven.values()))
        for name, pairs in driven.items():
            self.case_seconds[name] = self.case_seconds.get(name, 0.0) + pairs * each

    def plan(self, part: PairPart, answers: Iterable[OracleAnswer], owners: Owners) -> None:
        """Plan tours over the pairs that are to be driven; the others are counted as skipped."""
        self.parts.append(part)
        part.owners, oracle = owners, part.oracle
        unfit, limited = self.unfit(oracle), self.limited_by(oracle)
        missing_feature = [self.missing_feature(value) for value in oracle.inputs]
        targets = []
        for answer in answers:
            tally = self._tally(part, answer)
            if tally is None:
                continue
            part.totals["transitions" if answer.changes else "refusals"] += 1
            tally.total += 1
            why = unfit or missing_feature[answer.input]
            if not why and limited and answer.effect.rule == "MEM-1":
                why = f"{limited[0]} is fixed"
            if self.quick and not why and tally.total > FIRST:
                is_sampled = (answer.state + answer.input) % SHARES[answer.changes] == 0
                why = "" if is_sampled else WHOLE
            if why:
                tally.skipped[why] += 1
            else:
                targets.append((answer, tally.purpose.id))
        allowed = self.allowed(oracle)

        def disturbs(answer: OracleAnswer) -> bool:
            return self._tally(part, answer) is not None and allowed(answer.state, answer.input)

        tours = part.tours = Tours(oracle, targets, allowed, disturbs, self.seed)
        for state in [state for state in tours.left if tours.path(state) is None]:
            for pair, case in list(tours.left[state].items()):
                self.tallies[case].skipped["a feature that leads there"] += 1
                tours.done(pair)
        part.planned = len(targets)

    def tour(self, part: PairPart) -> None:
        """Test the planned pairs, as far as possible."""
        tours = part.tours
        while not self.cut_short and part.name not in self.stuck:
            tour = tours.next()
            if tour is None and not part.unsent and not part.sent:
                break
            if tour is not None:
                self._start(part, tour)
                self.adapter.pump()
                if self.adapter.slowness:
                    self.notify(f"{part.name}: {part.reached.total():,} of {part.planned:,}")
            unsent = sum(len(active.x.unwritten_steps) for active in part.unsent)
            if tour is None or unsent >= BULK:
                self.notify(f"{part.name}: {part.reached.total():,} of {part.planned:,}")
                self._judge_sent(part)
        if self.ended:  # what was sent is judged, too
            part.unsent = []
            self._judge_sent(part)
        if part.name in self.stuck:
            self.adapter.renew()
        if self.cut_short or part.name in self.stuck:
            return
        tours.usable(part.attempts)
        for state in [state for state in tours.left if tours.path(state) is not None]:
            for pair in list(tours.left[state]):
                self._forbidden(part, tours.done(pair))

    def _tally(self, part: PairPart, answer: OracleAnswer) -> Tally | None:
        """The case of a pair, if it is part of the run."""
        state, i = part.oracle.states[answer.state], part.oracle.inputs[answer.input]
        owner = part.owners.owner(state, i, answer.effect, answer.changes, part.third)
        return None if owner is None else self.tallies.get(owner.id)

    def unfit(self, oracle: Oracle) -> str:
        """Why this graph says nothing about the implementation; empty if it does."""
        rounds = oracle.constants["MaxRounds"]
        if self.fixed.get("max_rounds", rounds) != rounds:
            return f"max_rounds is fixed; the graph has {rounds}"
        peers, limits = len(oracle.constants["Peers"]), oracle.constants
        left_over = limits["OutboxLimit"] - max(limits["MaxParticipants"], rounds)
        participants = self.fixed.get("max_participants", limits["MaxParticipants"])
        least = {"memory_limit": peers, "max_participants": peers}
        least["outbox_limit"] = left_over + max(participants, rounds)  # MEM-1
        for name, needed in least.items():
            if self.fixed.get(name, needed) < needed:
                return f"{name} of at least {needed}"
        return ""

    def missing_feature(self, value: Input) -> str:
        """The missing feature that an input needs; empty if there is none."""
        match value:
            case Restart():
                needed = "restart"
            case Command(name=name):
                needed = NEEDS.get(name, "")
            case Receive(message=Message(type="Advertisement"), concerned=True):
                needed = "receiver"
            case _:
                return ""
        return "" if needed in self.features else needed

    def allowed(self, oracle: Oracle) -> Allowed:
        """Whether the station can be given an input in a state: it has the feature that the input
        needs, and MEM-1 does not decide there if a limit is fixed at another value."""
        missing_feature = [self.missing_feature(value) for value in oracle.inputs]
        limited = bool(self.limited_by(oracle))

        def allowed(state: int, i: int) -> bool:
            if missing_feature[i]:
                return False
            answer = oracle.answer(state, i) if limited else None
            return answer is None or answer.effect.rule != "MEM-1"

        return allowed

    def limited_by(self, oracle: Oracle) -> list[str]:
        """The limits that are fixed at another value than that of the graph: with one, what MEM-1
        decides cannot be observed."""
        return [
            n for n, c in LIMITS.items() if self.fixed.get(n, 0) not in (0, oracle.constants[c])
        ]

    # -- driving them

    def _start(self, part: PairPart, tour: list[int]) -> None:
        """Play another tour. Its lines are written together with those of other tours, if
        possible."""
        lease = LEASES[part.attempts.total() % len(LEASES)]
        values = VALUES[part.started % len(VALUES)]
        soonest = tuple(LONG)[part.started % len(LONG)]
        part.started += 1
        x = self.exchange(part.oracle, values=values, predict=self.predict, logged=False)
        active = TourInProgress(x, tour, lease, values, soonest)
        try:
            active.off = play(x, tour, self.timed, lease, soonest)
            if x.begun:
                x.flush()
        except (Wrong, Unpredicted) as error:
            self._finish(part, active, error)
            return
        if x.begun:
            self._finish(part, active)
        else:
            part.unsent.append(active)

    def _judge_sent(self, part: PairPart) -> None:
        """Read the answers to the tours that were sent, send those that wait, and judge the first
        while the station answers the second."""
        answered, part.sent, part.unsent = part.sent, part.unsent, []
        broken: AdapterError | None = None
        ended: tuple[TourInProgress, int] | None = None
        try:
            answers = self.adapter.answers()
        except AdapterError as error:
            answers, broken = error.answers, error
        if part.sent:
            self.adapter.send([line for f in part.sent for line in f.x.unwritten_lines])
        part.tours.mark_sent()
        for active in answered:
            asked = len(active.x.unwritten_steps)
            mine, answers = answers[:asked], answers[asked:]
            if len(mine) < asked and broken is None:
                break  # the process was renewed meanwhile; it is played again
            try:
                if len(mine) < asked and broken is not None and broken.kind in CRASHES:
                    active = self._singly(part, active)
                    ended = ended or (active, len(mine))
                else:
                    active.x.answered(mine, broken if len(mine) < asked else None)
            except (Wrong, Unpredicted) as wrong:
                self._finish(part, active, wrong)
                break  # what follows was not played, or may be out of step; it is played again
            self._finish(part, active)
        else:
            if broken is not None and ended is not None:
                self._ended_unrepeated(part, *ended, broken)
            elif broken is not None:
                text = f"{broken}; the same lines, sent one by one, do not end it"
                self.adapter.problems.append(text)

    def _ended_unrepeated(
        self, part: PairPart, active: TourInProgress, answered: int, broken: AdapterError
    ) -> None:
        """Blame the end of a used process at a tour that does not end a fresh one."""
        done = active.x.done
        pairs = [pair for step in done[: answered + 1] for pair in step.pairs]
        pairs = pairs or [pair for step in done for pair in step.pairs][:1]
        if not pairs:
            self.adapter.problems.append(f"{broken}; a fresh process does not end")
            return
        steps = [*done[:answered], replace(done[min(answered, len(done) - 1)], answer=b"")]
        ended = Broken(steps, broken)
        ended.unconfirmed = KEPT
        self._blame(part, pairs[-1], ended)

    def _singly(self, part: PairPart, active: TourInProgress) -> TourInProgress:
        """Play a tour again line by line in a fresh process: an adapter that reads many lines
        before it answers does not show which one it crashed at. Raises Mismatch and Broken."""
        counts = self.adapter.broken, self.adapter.hung
        self.adapter.renew()
        values, link = active.values, LineByLine(self.adapter)
        active.x = self.exchange(part.oracle, values=values, logged=False, link=link)
        try:
            active.off = play(active.x, active.tour, self.timed, active.lease, active.soonest)
            active.x.flush()
        finally:
            self.adapter.broken, self.adapter.hung = counts
        return active

    def _finish(
        self, part: PairPart, active: TourInProgress, error: Wrong | Unpredicted | None = None
    ) -> None:
        """Finish a tour. A wrong answer is confirmed, blamed on a case, and its pair avoided."""
        tours, x = part.tours, active.x
        for pair in (pair for step in x.done for pair in step.pairs):
            self._reached(part, tours.done(pair), pair)
        if error is not None:
            tours.forget_plans()
        if isinstance(error, Unpredicted):
            self.predict = False
        elif error is not None:
            self._wrong(part, active, error)
        elif active.off is not None:
            part.attempts[active.off] += 1
            if part.attempts[active.off] >= ATTEMPTS:
                self._forbidden(part, tours.avoid(active.off))

    def _forbidden(self, part: PairPart, case: str | None) -> None:
        """Count a pair that time does not allow."""
        if case is not None:
            part.forbidden += 1
            self.tallies[case].forbidden += 1

    def _reached(self, part: PairPart, case: str | None, pair: Pair) -> None:
        """Count a pair, if it was still to be driven."""
        if case is None:
            return
        tally = self.tallies[case]
        tally.reached += 1
        changes = part.oracle.is_move(*pair)
        part.reached["transitions" if changes else "refusals"] += 1
        tally.sample = tally.sample or (part, pair)

    # -- wrong answers

    def _wrong(self, part: PairPart, active: TourInProgress, error: Wrong) -> None:
        """Find the shortest exchange that fails in the same way, and the case it belongs to."""
        tours, tour = part.tours, active.tour
        self.resynchronize(error)
        self.hung(part, error)
        before = self.adapter.broken
        place = error.steps[-1].place
        inputs = tour[: place + 1]
        states = part.oracle.way(inputs[:-1])
        seen: Pair = (states[place], tour[place])
        tally = self._tally(part, part.oracle.given(*seen))
        if tally is not None:
            tally.hits += 1
            if tally.decided:
                tours.avoid(seen)
                tours.drop(tally.purpose.id)
                return

        kind = error.kind if isinstance(error, Broken) else ""
        hangs = kind == "hang"

        def attempt(again: list[int], soonest: str = active.soonest) -> Wrong | None:
            link = LineByLine(self.adapter) if kind else None  # shows the line of a crash
            x = self.exchange(part.oracle, values=active.values, link=link)
            try:
                play(x, again, self.timed, active.lease, soonest)
                x.flush()
            except Wrong as wrong:
                self.resynchronize(wrong)
                return wrong if len(wrong.steps) > 1 else None  # else not even reset was answered
            return None

        ways = [tours.path(state) for state in states]
        tries = 1 if hangs else STARTS if kind else RUNS
        short = shortened(part.oracle, inputs, ways, attempt, tries)
        least = short is not None
        if self.timed and not kind and (short is None or len(short[0]) > NEAR):
            short = _nearer(short, ways[-1], tour[place], error, attempt)
        if short is None and not hangs:  # less than the whole tour has another time-table
            whole = attempt(tour)
            if whole is not None and whole.steps[-1].place == place:
                short = inputs, whole
        self.adapter.broken = before  # each fault counts once, however often it is tried again
        if short is None:
            if not hangs:
                error = self.confirmed(tally, error, repeated=False)
            self._reached(part, tours.avoid(seen), seen)
            self._blame(part, seen, error)
            return
        inputs, error = short
        culprit, why = self._culprit(part, inputs, error, least)
        if self.timed and not kind and why and not part.oracle.is_move(*culprit):
            near = _nearer(short, tours.path(culprit[0]), culprit[1], error, attempt)
            self.adapter.broken = before
            if near is not None and near is not short:
                inputs, error = near
                culprit, why = self._culprit(part, inputs, error, True)
        blamed = self._tally(part, part.oracle.given(*culprit))
        error = self.confirmed(blamed, error, repeated=True)
        if culprit in tours.avoided:  # it has been blamed; each wrong answer takes something away
            tours.avoid(seen)
            return
        self._reached(part, tours.avoid(culprit), culprit)
        self._blame(part, culprit, error, why)

    def hung(self, part: PairPart, error: Wrong) -> None:
        """Count a hang, which takes the whole limit of an answer: the last one ends the part."""
        if not isinstance(error, Broken) or error.kind != "hang":
            return
        command = error.steps[-1].command
        about = command.get("message", {}).get("type") or command.get("command", {}).get("name")
        what = f"{command['cmd']} {about}" if about else command["cmd"]
        self._hangs[part.name, what] += 1
        if self._hangs[part.name, what] == HANGS:
            self.stuck.add(part.name)
            text = f"{part.name}: the rest is skipped after {HANGS} hangs at {what}"
            self.adapter.problems.append(text)

    def confirmed(self, tally: Tally | None, error: Wrong, *, repeated: bool) -> Wrong:
        """``in_fresh_process``, for the first failure of a case."""
        known = tally is None or any(not fault.unconfirmed for fault in tally.faults)
        if not known:
            return in_fresh_process(self.adapter, error, repeated=repeated)
        error.unconfirmed = "" if repeated else NONDETERMINISTIC
        return error

    def resynchronize(self, error: Wrong) -> None:
        """Use a fresh process for the next exchange if the station sent a line too many."""
        cause = error.error if isinstance(error, Broken) else None
        sealed = len(error.steps) > 1 and error.steps[-1].command["cmd"] == "reset"
        sealed = sealed or (isinstance(error, Mismatch) and not error.synchronized)
        if sealed or (isinstance(cause, ProtocolError) and not isinstance(cause, Refused)):
            self.adapter.renew()

    def _culprit(
        self, part: PairPart, inputs: list[int], error: Wrong, least: bool
    ) -> tuple[Pair, str]:
        """The pair to blame for a wrong exchange, and the reason if it is not the last one.
        ``least``: nothing can be left out of the exchange."""
        oracle, step = part.oracle, error.steps[-1]
        states = oracle.way(inputs[:-1])
        last = states[-1], inputs[-1]
        for state, i in zip(reversed(states[:-1]), reversed(inputs[:-1]), strict=True):
            if least and not oracle.is_move(state, i):
                return (state, i), "; an input before it, which must change nothing, changed that"
        pair = deciding_pair(oracle, error)
        if pair is not None and pair not in step.pairs and step.next_timer is not None:
            name = step.next_timer[0]
            assert isinstance(error, Mismatch) and step.expected.deadline is not None
            found = error.answer.deadline
            early = found is not None and found < step.expected.deadline
            wrong = "or another timer runs" if early else "or is not armed"
            lasts = "too short" if early else "too long"
            return pair, f"; the timer {name} lasts {lasts}, {wrong}"
        return last, ""

    def _blame(self, part: PairPart, pair: Pair, error: Wrong, why: str = "") -> None:
        tally = self._tally(part, part.oracle.given(*pair))
        if isinstance(error, Mismatch) and error.parts == {"cams"}:
            tally = self._cam_marks or tally
        purpose = tally.purpose if tally else None
        fault = self.labelled(part.oracle, pair, error, purpose, why)
        if tally is None:
            self.elsewhere = self.elsewhere or fault
            return
        if len(tally.faults) < ENOUGH:
            tally.faults.append(fault)
        if tally.decided:
            part.tours.drop(tally.purpose.id)

    def labelled(
        self,
        oracle: Oracle,
        pair: Pair | None,
        error: Wrong,
        purpose: Purpose | None,
        why: str = "",
    ) -> Wrong:
        """A wrong answer with what decides ``pair``; without one, with the case's first rule."""
        decided = Deciding(purpose.rules[0] if purpose else "")
        if pair is not None and oracle.answer(*pair) is not None:
            decided = deciding(oracle, error, pair)
        if isinstance(error, Mismatch) and error.problems[0].kind == MARKS:
            decided = Deciding("ACT-5")
        elif isinstance(error, Mismatch) and error.problems[0].kind == BACK_OFF:
            decided = Deciding("END-7")
        elif isinstance(error, Mismatch) and error.problems[0].kind.startswith("Ack.of"):
            decided = Deciding("END-6", "Ack", operators()["Ack"][0])
        elif isinstance(error, Mismatch) and error.parts == {"cams"} and purpose is not None:
            decided = Deciding(purpose.rules[0])
        error.deciding, error.more = decided, why
        return error


def _nearer(
    short: tuple[list[int], Wrong] | None,
    way: list[int] | None,
    last: int,
    error: Wrong,
    attempt: Callable[[list[int], str], Wrong | None],
) -> tuple[list[int], Wrong] | None:
    """A wrong answer on the shortest way to the failing input, with each timer in turn as the next
    to expire; ``short`` if that is not longer. A deadline that is wrong shows only if it is the
    next one."""
    if way is None or (short is not None and len(way) + 1 >= len(short[0])):
        return short
    timer = error.steps[-1].next_timer
    for name in sorted(LONG, key=lambda name: timer is None or name != timer[0]):
        wrong = attempt([*way, last], name)
        if wrong is None:
            continue
        inputs = [*way, last][: wrong.steps[-1].place + 1]
        if short is None or len(inputs) < len(short[0]):
            short = inputs, wrong
    return short
