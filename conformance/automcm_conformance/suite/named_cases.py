"""Runs the cases that have a name, and repeats one exchange of each case of a graph: for its log,
and because equal lines must get equal answers."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from automcm_conformance.exchange import records
from automcm_conformance.exchange.answers import Problem
from automcm_conformance.exchange.deciding import deciding_pair
from automcm_conformance.exchange.exchange import Mismatch, Step, Wrong
from automcm_conformance.exchange.play import play
from automcm_conformance.exchange.results import NONDETERMINISTIC
from automcm_conformance.exchange.tours import Pair
from automcm_conformance.scenarios import scenario_cases
from automcm_conformance.suite import off_graph_cases
from automcm_conformance.suite.endurance import MemoryWatch
from automcm_conformance.suite.graph_cases import Runner
from automcm_conformance.suite.purposes import Purpose
from automcm_conformance.suite.tally import PairPart, Tally


def special(runner: Runner, purpose: Purpose, part: PairPart, folder: Path) -> None:
    """Run a case by its name."""
    tally = runner.tallies[purpose.id]
    tally.total = 1
    missing = off_graph_cases.needs(purpose.case) - runner.features
    if missing or runner.cut_short or part.name in runner.stuck:
        tally.skipped.update(sorted(missing)[:1])
        return
    part = PairPart(part.name, off_graph_cases.graph(purpose.case, part.oracle))
    watch = MemoryWatch(runner.adapter)
    link = watch if purpose.case.startswith("quantity receptions") else None
    fresh = partial(runner.exchange, part.oracle, link=link)
    steps: list[Step] = []
    count = infeasible = 0
    try:
        for x in off_graph_cases.exchanges(purpose.case, fresh):
            count += x is not None
            infeasible += x is None
            steps = steps or (x.done if x is not None else [])
    except Wrong as error:
        runner.adapter.renew()
        runner.hung(part, error)
        wrong = runner.confirmed(tally, error, repeated=True)
        steps = wrong.steps
        pair = deciding_pair(part.oracle, wrong)
        tally.faults.append(runner.labelled(part.oracle, pair, wrong, purpose))
    runner.notes.append(watch.note)
    tally.reached = count + len(tally.faults)
    tally.forbidden = infeasible if runner.fixed else 0  # with the usual parameters it is meant so
    tally.total = tally.reached + tally.forbidden
    tally.log = records.log_of(folder, purpose.id, steps, runner.adapter.hello)


def scenario(runner: Runner, purpose: Purpose, folder: Path) -> None:
    """Run a scenario: several stations, each behind its own process."""
    tally = runner.tallies[purpose.id]
    tally.total = 1
    if runner.cut_short:
        return
    adapter = runner.adapter
    outcome = tally.outcome = scenario_cases.run(
        purpose.case,
        adapter.command,
        adapter.hello,
        folder,
        limit_s=adapter.limit_s,
        seed=runner.seed,
    )
    tally.log = outcome.log[0] if outcome.log else ""
    tally.reached = 0 if outcome.verdict == "SKIP" else 1


def samples(runner: Runner, folder: Path) -> None:
    """Play one exchange of each case of a graph twice: for its log, and because equal lines must
    get equal answers."""
    for name, tally in runner.tallies.items():
        if tally.faults:
            tally.log = records.log_of(folder, name, tally.faults[0].steps, runner.adapter.hello)
        elif tally.sample is not None and not runner.cut_short:
            runner.notify(f"log: {name}")
            _sample(runner, tally, *tally.sample, folder)


def _sample(runner: Runner, tally: Tally, part: PairPart, pair: Pair, folder: Path) -> None:
    way = part.tours.path(pair[0])
    if way is None:
        return
    runs: list[list[Step]] = []
    wrong: list[Wrong] = []
    for _ in range(2):
        x = runner.exchange(part.oracle)
        try:
            play(x, [*way, pair[1]], runner.timed)
            x.flush()
        except Wrong as error:
            runner.adapter.renew()
            wrong.append(error)
        runs.append(wrong[-1].steps if wrong else x.done)
    if wrong:
        fault = runner.confirmed(tally, wrong[0], repeated=len(wrong) == 2)
    else:
        tally.log = records.log_of(folder, tally.purpose.id, runs[0], runner.adapter.hello)
        both = ((one.answer, other.answer) for one, other in zip(*runs, strict=True))
        differ = next(((one, other) for one, other in both if one != other), None)
        if differ is None:
            return
        what = f"{differ[1][:200]!r}, before {differ[0][:200]!r}"
        fault = Mismatch(runs[1], [Problem("answer", what)])
        fault.unconfirmed = NONDETERMINISTIC
    tally.faults.append(runner.labelled(part.oracle, pair, fault, tally.purpose))
