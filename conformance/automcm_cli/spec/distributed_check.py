"""``automcm spec check --distributed``: checks a model together with remote workers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from automcm_spec.model_checking import distributed_tlc, models


def check(model: models.Model, host: str, notify: Callable[[str], None]) -> distributed_tlc.Shared:
    """Serve a model to workers; report their number and the progress."""
    workers = 0

    def line(text: str) -> None:
        nonlocal workers
        if text.startswith("Registration for worker"):
            workers += 1
            notify(f"{model.cfg}: {workers} workers")
        elif text.startswith("Progress("):
            notify(f"{model.cfg}: {workers} workers, {text}")

    notify(f"{model.cfg}: waiting for automcm spec worker {host}")
    return distributed_tlc.serve(model, host=host, on_line=line)


def shown(found: distributed_tlc.Shared) -> str:
    """The outcome as text."""
    model = found.model
    expected = f"NOT as expected: {found.problem}" if found.problem else "as expected"
    figures = f"{found.distinct_states:,} distinct states, {found.seconds:.1f} s"
    if found.outcome == "holds":
        return f"{model.cfg}: every safety property holds; {figures}; {expected}"
    return (
        f"{model.cfg}: a property is violated; {figures}; {expected}\n"
        f"for the property and the steps, run: automcm spec check {model.cfg}"
    )


def as_dict(found: distributed_tlc.Shared) -> dict[str, Any]:
    """A model and its outcome, for JSON."""
    return {
        "name": found.model.cfg,
        "expect": found.model.expect,
        "outcome": found.outcome,
        "distinct_states": found.distinct_states,
        "states": found.states,
        "seconds": round(found.seconds, 1),
        "problem": found.problem,
    }
