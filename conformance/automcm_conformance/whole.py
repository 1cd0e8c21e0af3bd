"""The whole suite against one implementation."""

from __future__ import annotations

import gc
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from automcm_conformance import named, remainder
from automcm_conformance.adapter import Adapter
from automcm_conformance.purposes import Owners, Purpose
from automcm_conformance.purposes import load as load_purposes
from automcm_conformance.results import BROKE, Report
from automcm_conformance.suite import Runner, Say
from automcm_conformance.tally import Part
from automcm_conformance.verdicts import Expectations, report
from automcm_spec.generate import ONE_PEER, TIGHT, TWO_PEERS
from automcm_spec.generate import spec_hash as present_hash
from automcm_spec.oracle import Oracle, OracleError, load


def conform(
    command: Sequence[str],
    purposes: Sequence[Purpose],
    folder: Path,
    *,
    limit_s: float,
    seed: int,
    say: Say,
    selectors: Sequence[str],
    expected: Expectations,
) -> Report:
    """Run these purposes; replays and logs are written into ``folder``.

    Raises AdapterError or ProtocolError if the adapter does not even say hello, and OracleError.
    """
    spec = present_hash()
    with uncollected():
        one = load(ONE_PEER.path, spec)
    owners = Owners(load_purposes())
    adapter = Adapter(command, limit_s)
    runner = Runner(adapter, purposes, seed, say)
    try:
        with uncollected():
            _drive(runner, one, owners, purposes, folder)
    except KeyboardInterrupt:
        runner.ended = "interrupted"
    except (OSError, OracleError):
        raise
    except Exception as error:  # a fault of ours must not cost what was found so far
        traceback.print_exc()
        runner.ended = f"{BROKE}: {type(error).__name__}: {error}"
    finally:
        adapter.stop()
    return report(runner, folder, spec, selectors, expected)


@contextmanager
def uncollected() -> Iterator[None]:
    """Without the collector of cycles: it would look at the graphs, millions of values that stay,
    again and again, and take a third of the time."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def _drive(
    runner: Runner, one: Oracle, owners: Owners, purposes: Sequence[Purpose], folder: Path
) -> None:
    if any(purpose.select for purpose in purposes):
        everything = (a for state in range(len(one.states)) for a in one.answers(state))
        runner.graph(Part("one-peer", one), everything, owners)
        two = load(TWO_PEERS.path, one.spec_hash)
        third = remainder.read(two)
        runner.graph(Part("two-peers, beyond one-peer", two, True), third, owners)
        tight = load(TIGHT.path, one.spec_hash)
        limits = (
            answer
            for state in range(len(tight.states))
            for answer in tight.answers(state)
            if answer.effect.rule == "MEM-1"
        )
        runner.graph(Part("tight, MEM-1", tight), limits, owners)
        named.samples(runner, folder)
    part = Part("special", one)
    for purpose in purposes:
        runner.say(purpose.case)
        if purpose.case.startswith("scenario "):
            named.scenario(runner, purpose, folder)
        elif purpose.case:
            named.special(runner, purpose, part, folder)
