"""Stations of the reference under hypothesis: whatever the radio and the drivers do, S-1 … S-7 and
T-1 … T-3 hold, and every station does what Station.tla says.

``World`` (stateful_world.py) is a few stations, the copies of messages in flight between them, one
clock, and all the checks.  ``Coordination`` is its state machine: a rule for each thing that can
happen.  Each input of a station is given to the compiled Station.tla too (stateful_oracle.py), on
the same ids and limits, and all effects are compared.

    python reference/tests/stateful.py --steps 1000000 --seed 1

runs the deep profile: many machines, in two processes.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import sys
import time
from collections.abc import Sequence
from unittest import mock

import hypothesis
from hypothesis import HealthCheck, Phase, settings
from hypothesis.internal.conjecture.providers import HypothesisProvider
from hypothesis.stateful import run_state_machine_as_test
from stateful_machine import Coordination
from stateful_oracle import Coverage
from stateful_surroundings import Call


def profile(examples: int, steps: int, *, steered: bool = False, shrink: bool = False) -> settings:
    """``steered``: half of the machines climb towards what ``teardown`` names as targets.

    Nothing depends on the wall clock: no deadline, and ``too_slow`` is suppressed because it
    would fail on a busy computer.
    """
    phases = [Phase.generate, *[Phase.target] * steered, *[Phase.shrink] * shrink]
    return settings(
        max_examples=examples,
        stateful_step_count=steps,
        phases=phases,
        deadline=None,
        database=None,
        report_multiple_bugs=False,
        suppress_health_check=[HealthCheck.too_slow],
    )


def run(machine: type[Coordination], profile: settings, seed: int) -> Coverage:
    """Run machines and return their coverage.  Raises Broken; ``machine.last`` has the exchange.

    Hypothesis also draws constants that it finds in whatever modules are loaded.  Not here: the
    same seed is to draw the same whatever else runs in the process.
    """
    machine.coverage = Coverage()
    hypothesis.seed(seed)(machine)
    with mock.patch.object(HypothesisProvider, "_maybe_draw_constant", lambda *_, **__: None):
        run_state_machine_as_test(machine, settings=profile)
    return machine.coverage


def told(calls: Sequence[Call]) -> str:
    """An exchange, as a program."""
    lines = [f"m.{name}({', '.join(f'{k}={v!r}' for k, v in d.items())})" for name, d in calls]
    return "\n".join(["m = Coordination()", *lines])


# -- the deep profile


def batch(seed: int) -> tuple[int, Coverage, str]:
    """Some thousand steps.  Returns their coverage and the failures."""
    steps, steered = 50 + 50 * (seed % 2), seed % 4 == 3
    try:
        run(Coordination, profile(100, steps, steered=steered, shrink=True), seed)
    except Exception as error:
        text = f"seed {seed}: {type(error).__name__}: {error}\n{told(Coordination.last)}"
        return seed, Coordination.coverage, text
    return seed, Coordination.coverage, ""


def main() -> int:
    parser = argparse.ArgumentParser(description="The deep profile of the stateful tests.")
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1, help="the first; each batch has its own")
    parser.add_argument("--processes", type=int, default=2)
    wanted = parser.parse_args()
    total, failures, seed, began = Coverage(), 0, wanted.seed, time.monotonic()
    with multiprocessing.get_context("spawn").Pool(wanted.processes) as pool:
        for seed, coverage, broke in pool.imap(batch, itertools.count(wanted.seed)):
            total.add(coverage)
            if broke:
                failures += 1
                print(broke, flush=True)
            if sys.stderr.isatty():
                print(f"\r{total.steps} steps, seed {seed}", end="", file=sys.stderr, flush=True)
            if total.steps >= wanted.steps or failures >= 5:
                break
        pool.terminate()
    seconds = time.monotonic() - began
    print(f"seeds {wanted.seed} to {seed}, {seconds:.0f} s, {total.steps / seconds:.0f} steps/s")
    print(total.report())
    print(f"{failures} batches failed")
    return 1 if failures or total.missing() else 0


if __name__ == "__main__":
    sys.exit(main())
