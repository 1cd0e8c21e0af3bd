"""Runs the suite on a station that is known to be wrong, to find the cases that fail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import ProtocolError
from automcm_conformance.exchange import transcript
from automcm_conformance.scenarios import scenario_cases
from automcm_conformance.suite import named_cases
from automcm_conformance.suite.graph_cases import Runner
from automcm_conformance.suite.purposes import Purpose
from automcm_conformance.suite.suite_run import Graphs, special, tours
from automcm_spec.support.collection import uncollected

RUNS, STARTS = 12, 2
"""Tries to shorten a failure: few, because only the failing case is needed."""


@dataclass
class Kills:
    """The cases that do not pass (FAIL or ERROR)."""

    cases: list[str] = field(default_factory=list)
    what: str = ""
    """The finding of the first of them."""
    unstarted: int | None = None
    """The exit code of a station that did not answer hello (0: it kept running)."""
    late: bool = False
    """Whether the time limit came before enough cases failed."""


class _Late(Exception):
    pass


def kills(
    command: Sequence[str],
    graphs: Graphs,
    purposes: Sequence[Purpose],
    folder: Path,
    *,
    enough: int,
    seed: int,
    limit_s: float,
    until_s: float,
    brief: bool = False,
    quick: bool = False,
) -> Kills:
    """Run these purposes until ``enough`` cases fail (0 = run all), the fast ones first.

    ``limit_s`` is the time limit for an answer, ``until_s`` approximately that for all.  With
    ``brief``, a wrong answer that belongs to none of these cases ends the run, too.  ``quick``: as
    ``conform run --quick``.

    Raises OSError, OracleError.
    """
    due = monotonic() + until_s

    def notify(_: str) -> None:
        if monotonic() > due or (brief and runner.elsewhere):
            raise _Late

    try:
        adapter = Adapter(command, limit_s)
    except (AdapterError, ProtocolError) as error:
        return Kills(what=str(error), unstarted=getattr(error, "exit_code", None) or 0)
    runner = Runner(adapter, purposes, seed, notify)
    runner.enough, runner.runs, runner.starts = enough, RUNS, STARTS
    runner.quick = quick
    runner.confirms = False  # a mutant is deterministic, and each takes a new process
    last = [purpose for purpose in purposes if purpose.case in scenario_cases.NAMES]
    late = False
    try:
        with uncollected():
            special(runner, graphs, [p for p in purposes if p not in last], folder)
            if any(purpose.select for purpose in purposes):
                tours(runner, graphs)
                if not quick:
                    named_cases.samples(runner, folder)
            special(runner, graphs, last, folder)
    except _Late:
        late = True
    finally:
        adapter.stop()
    return Kills(runner.failed, _what(runner), late=late)


def _what(runner: Runner) -> str:
    for name in runner.failed:
        tally = runner.tallies[name]
        if tally.faults:
            return tally.faults[0].what
        if tally.outcome is not None:
            return transcript.finding(tally.outcome.finding) or tally.outcome.reason
    return ""
