"""Confirms a wrong answer in a fresh process, line by line, as a replay does.

A station that is wrong only in a used process keeps state over a reset, or is nondeterministic.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import replace

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.exchange.answers import differences
from automcm_conformance.exchange.exchange import Broken, Mismatch, Step, Wrong
from automcm_conformance.exchange.records import failure_of
from automcm_conformance.exchange.results import KEPT, NONDETERMINISTIC

UNSHOWN = ("hang", "start")
"""Failures of the process that are not repeated: a hang takes the whole limit of an answer."""


def in_fresh_process(adapter: Adapter, error: Wrong, *, repeated: bool) -> Wrong:
    """The failure in a fresh process, up to the very line that shows it.

    If a fresh process does not fail: the given error, which says so in ``unconfirmed``. State is
    kept only if the used process fails again at these lines; if it has been ended, if it has failed
    before (``repeated``). Crashes on the way do not count.
    """
    if not _shows(error):
        return error
    counts = adapter.broken, adapter.hung
    steps = error.sent if isinstance(error, Broken) else error.steps
    try:
        if isinstance(error, Mismatch) and adapter.runs:
            repeated = _again(adapter, error, steps) is not None
        adapter.renew()
        if found := _again(adapter, error, steps):
            alike = type(found) is type(error) is Mismatch and len(found.steps) == len(error.steps)
            return error if alike else found
        is_kept = _again(adapter, error, steps) is not None
        if not is_kept:
            adapter.renew()
            is_kept = repeated and not _again(adapter, error, steps)
        error.unconfirmed = KEPT if is_kept else NONDETERMINISTIC
        return error
    finally:
        adapter.renew()
        adapter.broken, adapter.hung = counts


def _shows(error: Wrong) -> bool:
    """Whether the lines of an exchange alone show what is wrong."""
    if isinstance(error, Broken):
        return error.kind not in UNSHOWN
    last = error.steps[-1]
    return bool(differences(deepcopy(last.expected), last.answer))


def _again(adapter: Adapter, error: Wrong, steps: Sequence[Step]) -> Wrong | None:
    """The first failure when these lines are sent one by one; None if there is none."""
    again = [replace(given, expected=deepcopy(given.expected), answer=b"") for given in steps]
    wrong = failure_of(again, adapter)
    if isinstance(wrong, Mismatch) and isinstance(error, Mismatch):
        wrong.session = error.session
    return wrong
