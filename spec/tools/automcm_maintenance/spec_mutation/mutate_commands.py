"""``automcm spec mutate``: selects mutants, runs them and formats the report."""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Callable, Sequence
from typing import get_args

import typer
from rich.console import Console
from rich.markup import escape

from automcm_maintenance.documents.repository import ROOT
from automcm_maintenance.spec_mutation import mutant_results, mutant_runs
from automcm_maintenance.spec_mutation.mutant_rules import KINDS
from automcm_maintenance.spec_mutation.mutant_runs import MutationError, MutationReport, Profile
from automcm_maintenance.spec_mutation.mutants import MissingPackage, Mutant, generate, sample
from automcm_spec.model_checking import models

KEPT = ROOT / "runs" / "mutation"
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
    profile: str, mutants: Sequence[Mutant], jobs: int, notify: Callable[[str], None]
) -> MutationReport:
    """Run the models that must hold on the mutants."""
    chosen = [
        model
        for model in models.of_profile(models.load(), "full")
        if model.expect == "holds" and model.seconds <= LONGEST_S
    ]
    known = mutant_results.reasons()
    report = mutant_runs.run(
        mutants,
        chosen,
        profile="deep" if profile == "deep" else "quick",
        kept=KEPT,
        jobs=jobs,
        notify=notify,
    )
    ids = {mutant.id for mutant in generate()}
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


def about(report: MutationReport) -> str:
    """The profile of a run, and how many of the mutants it had."""
    return f"{report.profile} run of {report.selected} of {len(generate())}"


def show(report: MutationReport, console: Console) -> None:
    """Print the figures, the survivors and the problems."""
    results = mutant_results.MutationResults(
        inputs=mutant_results.present(), run=about(report), mutants=report.rows
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
        console.print(f"Incomplete: {done} of {report.selected}; repeat the command to continue")
