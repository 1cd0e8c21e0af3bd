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
from typing import Any
from unittest import mock

import hypothesis
from hypothesis import HealthCheck, Phase, settings
from hypothesis.internal.conjecture.providers import HypothesisProvider
from hypothesis.stateful import run_state_machine_as_test
from stateful_machine import NAMES, UPTO, Coordination
from stateful_oracle import LEASES, Broken, Coverage
from stateful_surroundings import Call


def profile(examples: int, steps: int, *, steered: bool = False) -> settings:
    """``steered``: half of the machines climb towards what ``teardown`` names as targets.

    Nothing depends on the wall clock: no deadline, and ``too_slow`` is suppressed because it
    would fail on a busy computer.  Shrinking is left to ``shortened``.
    """
    phases = [Phase.generate, Phase.target] if steered else [Phase.generate]
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


def repeated(machine: type[Coordination], calls: Sequence[Call]) -> str:
    """Do the same again, without hypothesis.  Returns what broke, "" for nothing, and "?" if a
    step cannot be taken."""
    again = machine()
    try:
        for name, drawn in calls:
            getattr(again, name)(**drawn)
    except Broken as error:
        return error.what
    except (ZeroDivisionError, KeyError):
        return "?"
    return ""


def shortened(machine: type[Coordination], calls: Sequence[Call], what: str) -> list[Call]:
    """The exchange without the steps that are not needed for ``what`` to break.

    Hypothesis leaves some: what is drawn for one step decides how the next is read.
    """
    kept = list(calls)

    def fails(candidate: list[Call]) -> bool:
        nonlocal kept
        if candidate == kept or repeated(machine, candidate) != what:
            return False
        kept = candidate
        return True

    before: list[Call] = []
    while kept != before:
        before = kept
        for size in (8, 4, 2, 1):
            at = len(kept) - size
            while at > 0:  # the first call sets up
                fails(kept[:at] + kept[at + size :])
                at = min(at, len(kept)) - size
        for at, (name, drawn) in enumerate(kept):
            for argument, value in drawn.items():
                for simpler in SIMPLER.get(argument, (type(value)(),)):
                    now = kept[at][1]
                    if now[argument] == simpler:
                        break
                    if fails([*kept[:at], (name, {**now, argument: simpler}), *kept[at + 1 :]]):
                        break
    return kept


SIMPLER: dict[str, tuple[Any, ...]] = {
    "lease": LEASES,
    "upto": UPTO,
    "name": NAMES,
    "ms": (1, 200),
    "deadlines": (1, 2, 3),
    "rounds": tuple(range(1, 9)),
    "stations": tuple(range(2, 13)),
    "participants": (12, 1, 2, 3, 5, 7),
    "spare": (20, 0, 1, 2, 3),
    "memory": (12, 1, 2, 3),
    "times": (1, 2),
    "what": tuple(range(9)),
}
"""Values to try, simplest first; elsewhere 0, False or nothing."""


def told(calls: Sequence[Call]) -> str:
    """An exchange, as a program."""
    lines = [f"m.{name}({', '.join(f'{k}={v!r}' for k, v in d.items())})" for name, d in calls]
    return "\n".join(["m = Coordination()", *lines])


# -- the deep profile


def batch(seed: int) -> tuple[int, Coverage, str]:
    """Some thousand steps.  Returns their coverage and the failures."""
    try:
        run(Coordination, profile(100, 50 + 50 * (seed % 2), steered=seed % 4 == 3), seed)
    except Broken as error:
        calls = shortened(Coordination, Coordination.last, error.what)
        return seed, Coordination.coverage, f"seed {seed}: {error}\n{told(calls)}"
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
