"""``automcm spec mutate``: selects mutants, runs them and formats the report."""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Callable, Sequence
from typing import get_args

import typer
from rich.console import Console
from rich.markup import escape

from automcm_maintenance.spec_mutation import mutant_results, mutant_runs
from automcm_maintenance.spec_mutation.mutant_rules import KINDS
from automcm_maintenance.spec_mutation.mutant_runs import (
    MutantOutcome,
    MutationError,
    MutationReport,
    Profile,
)
from automcm_maintenance.spec_mutation.mutants import MissingPackage, Mutant, generate, sample
from automcm_spec.model_checking import models

PROFILES: tuple[str, ...] = get_args(Profile)
LONGEST_S = 6
"""The quick and full models that take no longer, in seconds, are run."""
FAULTS = (MissingPackage, MutationError, models.ModelError, OSError, ValueError)
"""Errors that end a run with exit code 3."""


def select(only: str | None, limit: int) -> list[Mutant]:
    """The mutants whose id matches the pattern (* ?, or a part of the id), sampled (``sample``)."""
    mutants = generate()
    if only is not None:
        pattern = only if any(c in only for c in "*?[") else f"*{only}*"
        mutants = [mutant for mutant in mutants if fnmatch.fnmatchcase(mutant.id, pattern)]
        if not mutants:
            raise typer.BadParameter(f"no mutant matches {only!r}")
    return sample(mutants, limit or None)


def listed(mutants: Sequence[Mutant]) -> str:
    """The text for --list: line and change of each mutant, and the number of each kind."""
    lines = [f"{m.id}  {m.module}.tla:{m.line}\n    {m.change}" for m in mutants]
    kinds = Counter(m.kind for m in mutants)
    counts = ", ".join(f"{kinds[kind]} {kind}" for kind in KINDS if kinds[kind])
    return "\n".join([*lines, f"{len(mutants)} mutants: {counts}"])


def run(
    profile: str, mutants: Sequence[Mutant], jobs: int, notify: Callable[[str], None], write: bool
) -> MutationReport:
    """Run the models that must hold on the mutants, in the order of ``sample``.

    ``write``: write each result at once, and run no mutant whose written result still holds.
    """
    chosen = [
        model
        for model in models.of_profile(models.load(), "full")
        if model.expect == "holds" and model.seconds <= LONGEST_S
    ]
    known, ids = mutant_results.reasons(), {mutant.id for mutant in generate()}
    before = mutant_results.before(profile) if write else []
    rows = {row.id: row for row in before}

    def keep(outcome: MutantOutcome) -> None:
        if write and not outcome.invalid:
            rows[outcome.mutant.id] = outcome.row
            mutant_results.write(about(profile, len(rows), len(ids)), [*rows.values()])

    report = mutant_runs.run(
        [mutant for mutant in mutants if mutant.id not in rows],
        chosen,
        profile="deep" if profile == "deep" else "quick",
        jobs=jobs,
        notify=notify,
        keep=keep,
    )
    report.before = before
    report.problems += mutant_results.problems(report.rows, known, ids)
    return report


def as_dict(report: MutationReport) -> dict[str, object]:
    """The report as JSON."""
    return {
        "profile": report.profile,
        "complete": report.complete,
        "mutants": [o.row.model_dump() | {"invalid": o.invalid} for o in report.outcomes],
        "problems": report.problems,
    }


def about(profile: str, number: int, whole: int) -> str:
    """The profile of a run, and how many of the mutants it had."""
    return f"{profile} run of {number} of {whole}"


def show(report: MutationReport, console: Console) -> None:
    """Print the figures, the survivors and the problems."""
    run = about(report.profile, len(report.rows), len(generate()))
    results = mutant_results.MutationResults(
        inputs=mutant_results.present(), run=run, mutants=report.rows
    )
    console.print(escape(results.summary), soft_wrap=True)
    for o in report.outcomes:
        if o.survived or o.invalid:
            word = "Invalid " if o.invalid else "Survived"
            where = f"{o.mutant.id}  {o.mutant.module}.tla:{o.mutant.line}"
            console.print(f"{word}    {where}  ({o.row.how})", soft_wrap=True)
            console.print(f"            {escape(o.mutant.change)}", soft_wrap=True)
    for text in report.problems:
        console.print(f"[red]Problem[/]     {escape(text)}", soft_wrap=True)
    if not report.complete:
        done = len(report.outcomes)
        console.print(f"Incomplete: {done} of {report.selected}")
