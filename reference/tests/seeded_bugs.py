"""Bugs to be found: the catalogue ``seeded``, put into this process while a machine runs."""

from __future__ import annotations

from stateful import Call, Coordination, profile, run
from stateful_oracle import ALL, PROPERTIES, Broken

from automcm_maintenance.code_mutation import faults
from automcm_maintenance.code_mutation.faults import Fault

BUGS = faults.load("seeded")


def hunt(bug: Fault, seed: int) -> tuple[str, list[Call]]:
    """The violated property ("" for none), and an exchange that violates it."""
    what = bug.notice["what"]
    checks = frozenset({what}) if what in PROPERTIES else ALL
    machine = type("Seeded", (Coordination,), {"checks": checks})
    with faults.put(bug):
        try:
            run(machine, profile(200, 40), seed)
        except Broken as error:
            return error.what, machine.last
    return "", []


if __name__ == "__main__":  # to renew the catalogue: seeds that find each, with the steps they take
    for name, bug in BUGS.items():
        found = [
            (len(calls) - 1, seed, what)
            for seed in range(1, 10)
            for what, calls in [hunt(bug, seed)]
            if what
        ]
        print(f"{name}: {bug.notice}: steps, seed, what broke: {sorted(found)}", flush=True)
