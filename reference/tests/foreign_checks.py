"""Runs the checks of a ``foreign_*.py`` one by one; ``make test-foreign``."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence


def run(what: str, checks: Sequence[Callable[[], None]], skip: str | None) -> int:
    """Run all ``checks`` and print the result of each; the exit code.

    ``skip`` says why what they need is missing; then none is run.
    """
    if skip is not None:
        print(f"SKIPPED: {what}: {skip}")
        print(f"0 passed, 0 failed, {len(checks)} skipped")
        return 0
    failed = 0
    for check in checks:
        name = check.__name__.replace("_", " ")
        try:
            check()
            print(f"ok      {name}", flush=True)
        except Exception as error:
            failed += 1
            where = traceback.extract_tb(error.__traceback__)[1]
            print(f"FAILED  {name}, line {where.lineno}: {error!r}", flush=True)
    print(f"{len(checks) - failed} passed, {failed} failed")
    return 1 if failed else 0
