"""Runs the whole suite against one implementation."""

from __future__ import annotations

import gc
import signal
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import monotonic

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.exchange.results import BROKE, INTERRUPTED, Report
from automcm_conformance.scenarios import scenario_cases
from automcm_conformance.suite import named_cases, two_peer_pairs
from automcm_conformance.suite.endurance import nesting
from automcm_conformance.suite.graph_cases import Notify, Runner
from automcm_conformance.suite.off_graph_cases import TWO, two_peers
from automcm_conformance.suite.purposes import Owners, Purpose
from automcm_conformance.suite.purposes import load as load_purposes
from automcm_conformance.suite.tally import WHOLE, PairPart
from automcm_conformance.suite.verdicts import Expectations, report
from automcm_spec.graph.oracle import Oracle, OracleError, load
from automcm_spec.graph.oracle_generation import ONE_PEER, TIGHT
from automcm_spec.graph.oracle_generation import spec_hash as present_hash
from automcm_spec.support.collection import uncollected

LONG = ("quantity sessions", "quantity receptions", "quantity messages")
"""The first words of the cases that ``--quick`` omits because they are long."""


def conform(
    command: Sequence[str],
    purposes: Sequence[Purpose],
    folder: Path,
    *,
    limit_s: float,
    seed: int,
    notify: Notify,
    selectors: Sequence[str],
    expected: Expectations,
    stop_after: int = 0,
    quick: bool = False,
) -> Report:
    """Run these purposes; replays and logs are written into ``folder``.

    ``stop_after``: this many failed cases end the run (0: none do). ``quick``: only a part of the
    suite (``Runner.quick``).

    Raises AdapterError or ProtocolError if the adapter does not answer ``hello``, and OracleError.
    """
    spec = present_hash()
    with uncollected():
        one = load(ONE_PEER.path, spec)
    adapter = Adapter(command, limit_s)
    runner = Runner(adapter, purposes, seed, notify)
    runner.enough, runner.quick = stop_after, quick
    with keeping_results(runner), uncollected(), _finishing(runner):
        if any(purpose.select for purpose in purposes):
            tours(runner, one)
            if not quick:
                named_cases.samples(runner, folder)
        special(runner, one, purposes, folder)
        discards = any(purpose.case.startswith("malformed ") for purpose in purposes)
        if discards and not runner.cut_short:
            (reset,) = runner.exchange(one).unwritten_lines
            runner.notes.append(nesting(adapter, reset))
    return report(runner, folder, spec, selectors, expected)


@contextmanager
def keeping_results(runner: Runner) -> Iterator[None]:
    """Ctrl-C and a fault of ours end the run, but keep what was found so far; the adapter is
    stopped. Raises OSError and OracleError."""
    try:
        yield
    except KeyboardInterrupt:
        runner.ended = INTERRUPTED
        runner.adapter.renew()  # a partial line may have been written
    except (OSError, OracleError):
        raise
    except Exception as error:
        traceback.print_exc()
        runner.broke, runner.ended = True, f"{BROKE}: {type(error).__name__}: {error}"
    finally:
        runner.adapter.stop()


@contextmanager
def _finishing(runner: Runner) -> Iterator[None]:
    """The first Ctrl-C lets the run judge what was sent; the second ends it at once."""

    def end(*_: object) -> None:
        if runner.ended:
            raise KeyboardInterrupt
        runner.ended = INTERRUPTED

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    was = signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, was)


def tours(runner: Runner, one: Oracle) -> None:
    """Test the pairs of the graphs. Raises OracleError."""
    owners, rules = Owners(load_purposes()), runner.rules
    runner.graph(PairPart("one-peer", one), one.decided_by(rules), owners)
    if not runner.quick:
        two = two_peers(one.spec_hash)
        third = [answer for answer in two_peer_pairs.read(two) if answer.effect.rule in rules]
        runner.graph(PairPart("two-peers, beyond one-peer", two, True), third, owners)
    tight = load(TIGHT.path, one.spec_hash)
    limits = tight.decided_by(rules & {"MEM-1"})
    runner.graph(PairPart("tight, MEM-1", tight), limits, owners)


def special(runner: Runner, one: Oracle, purposes: Sequence[Purpose], folder: Path) -> None:
    """Run the named cases. Garbage is collected before them, and between them without what was
    there before."""
    part = PairPart("special", one)
    gc.collect()
    gc.freeze()
    try:
        for purpose in purposes:
            if not purpose.case:
                continue
            runner.notify(purpose.case)
            started = monotonic()
            is_scenario = purpose.case in scenario_cases.NAMES
            if runner.quick and (is_scenario or purpose.case.startswith((*TWO, *LONG))):
                runner.tallies[purpose.id].total = 1
                runner.tallies[purpose.id].skipped[WHOLE] += 1
            elif is_scenario:
                named_cases.scenario(runner, purpose, folder)
            else:
                named_cases.special(runner, purpose, part, folder)
            runner.case_seconds[purpose.id] = monotonic() - started
            gc.collect()
    finally:
        gc.unfreeze()
