"""``automcm spec mutate``: selects mutants, runs them and formats the report."""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from automcm_maintenance.documents.repository import ROOT
from automcm_maintenance.spec_mutation import mutant_results, mutant_runs
from automcm_maintenance.spec_mutation.mutant_results import HEADS
from automcm_maintenance.spec_mutation.mutant_rules import KINDS, MODULES
from automcm_maintenance.spec_mutation.mutant_runs import MutationError, MutationReport, Profile
from automcm_maintenance.spec_mutation.mutants import MissingPackage, Mutant, generate, sample
from automcm_spec.model_checking import models
from automcm_spec.support.paths import TLA

KEPT = ROOT / "runs" / "mutation"
PROFILES: tuple[str, ...] = get_args(Profile)


class Usage(Exception):
    """A name that does not exist, or options that do not fit together."""


FAULTS = (MissingPackage, MutationError, models.ModelError, OSError, ValueError)
"""Errors that end a run with exit code 3."""


@dataclass
class Asked:
    """The options of the command.  Raises Usage if they cannot be combined."""

    profile: str
    modules: Sequence[str] | None
    models: Sequence[str] | None
    only: str | None
    limit: int | None
    jobs: int
    longest_s: float
    write: bool

    def __post_init__(self) -> None:
        if self.profile not in PROFILES:
            raise Usage(f"--profile must be one of {', '.join(PROFILES)}, not {self.profile!r}")
        if self.write and (self.only or self.modules or self.models):
            raise Usage("--write cannot be combined with --only, --module or --model")
        if self.write and self.profile != "deep":
            raise Usage("--write needs --profile deep")
        self.modules = self.modules or MODULES
        if unknown := [name for name in self.modules if not (TLA / f"{name}.tla").is_file()]:
            raise Usage(f"there is no module {', '.join(unknown)}")


def select(asked: Asked) -> list[Mutant]:
    """The mutants of the modules whose id matches the pattern (* ?, or a part of the id), sampled
    (``sample``)."""
    mutants = generate(modules=asked.modules or MODULES)
    if (only := asked.only) is not None:
        pattern = only if any(c in only for c in "*?[") else f"*{only}*"
        mutants = [mutant for mutant in mutants if fnmatch.fnmatchcase(mutant.id, pattern)]
        if not mutants:
            raise Usage(f"no mutant matches {only!r}")
    return sample(mutants, asked.limit or None)


def listed(mutants: Sequence[Mutant]) -> str:
    """The text for --list: line and change of each mutant, and the number of each kind."""
    lines = [f"{m.id}  {m.module}.tla:{m.line}\n    {m.change}" for m in mutants]
    kinds = Counter(m.kind for m in mutants)
    counts = ", ".join(f"{kinds[kind]} {kind}" for kind in KINDS if kinds[kind])
    return "\n".join([*lines, f"{len(mutants)} mutants: {counts}"])


def as_rows(mutants: Sequence[Mutant]) -> list[dict[str, Any]]:
    """The rows for --list --json."""
    return [
        {"id": m.id, "kind": m.kind, "line": m.line, "before": m.before, "after": m.after}
        for m in mutants
    ]


def run(asked: Asked, mutants: Sequence[Mutant], notify: Callable[[str], None]) -> MutationReport:
    """Run the named models on the mutants; by default the quick and full ones up to longest_s.

    The list of reasons is only compared if no models are named.
    """
    loaded = [model for model in models.load() if model.expect == "holds"]
    if unknown := set(asked.models or ()) - {model.cfg for model in loaded}:
        raise Usage(f"there is no model that must hold called {', '.join(sorted(unknown))}")
    usual = [m for m in models.of_profile(loaded, "full") if m.seconds <= asked.longest_s]
    chosen = [m for m in loaded if m.cfg in asked.models] if asked.models else usual
    modules, known = asked.modules or MODULES, mutant_results.reasons()
    report = mutant_runs.run(
        mutants,
        chosen,
        profile="deep" if asked.profile == "deep" else "quick",
        kept=KEPT,
        jobs=asked.jobs,
        notify=notify,
    )
    if not asked.models:
        ids = {mutant.id for mutant in generate(modules=modules)}
        report.problems += mutant_results.problems(report.rows, known, ids, modules)
    return report


def as_dict(report: MutationReport) -> dict[str, Any]:
    """The report as JSON."""
    return {
        "profile": report.profile,
        "complete": report.complete,
        "selected": report.selected,
        "kinds": {
            kind: dict(zip(HEADS, n, strict=True))
            for kind, n in mutant_results.by_kind(report.rows).items()
        },
        "properties": mutant_results.by_property(report.rows),
        "problems": report.problems,
        "mutants": [outcome.as_dict() for outcome in report.outcomes],
    }


def show(report: MutationReport, console: Console) -> None:
    """Print the tables, the survivors and the problems."""
    table = Table(title="Mutants: what finds them", title_justify="left", box=None)
    table.add_column("kind", no_wrap=True)
    for name in HEADS:
        table.add_column(name, justify="right")
    for kind, numbers in mutant_results.by_kind(report.rows).items():
        table.add_row(kind, *(str(n) if n else "-" for n in numbers))
    console.print(table)
    killed = mutant_results.by_property(report.rows)
    first = "" if report.profile == "deep" else " (the first to find a mutant)"
    texts = ", ".join(f"{name} {n}" for name, n in killed.items())
    console.print(f"Killed by property{first}: {texts}", soft_wrap=True)
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


def write(report: MutationReport) -> None:
    """Write the results of a complete report, from which the page is built."""
    if report.complete:
        mutant_results.write(report.rows)
