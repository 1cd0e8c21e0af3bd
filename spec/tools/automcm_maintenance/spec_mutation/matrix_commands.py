"""``automcm spec mutate --matrix``: runs the matrix, reports it, and writes the committed files."""

from __future__ import annotations

import fnmatch
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.markup import escape

from automcm_maintenance.documents import matrix_page
from automcm_maintenance.documents.matrix_page import Head, MatrixEntry
from automcm_maintenance.documents.repository import ROOT
from automcm_maintenance.spec_mutation import matrix
from automcm_maintenance.spec_mutation.mutants import generate, sample
from automcm_maintenance.spec_mutation.mutate_commands import Usage
from automcm_spec.model_checking import models
from automcm_spec.support import files

CELLS = ROOT / "runs" / "matrix.jsonl"


@dataclass(frozen=True)
class MatrixReport:
    """The matrix; not complete if the run was interrupted."""

    head: Head
    entries: list[MatrixEntry]
    complete: bool
    problems: list[str]

    @property
    def exit_code(self) -> int:
        """0 as expected, 1 if a reason is missing or obsolete, 4 if not complete."""
        return 4 if not self.complete else 1 if self.problems else 0


def run(
    cfgs: Sequence[str] | None,
    only: str | None,
    limit: int | None,
    jobs: int,
    sparing: bool,
    notify: Callable[[str], None],
) -> MatrixReport:
    """Run the matrix, by default all mutants in the models of ``matrix.CFGS``.

    The reasons are only compared if nothing is left out.  Raises Usage for an unknown name.
    """
    loaded = {model.cfg: model for model in models.load() if model.expect == "holds"}
    names = list(cfgs or matrix.CFGS)
    if unknown := [name for name in names if name not in loaded]:
        raise Usage(f"there is no model that must hold called {', '.join(unknown)}")
    mutants = generate(modules=[matrix.MODULE])
    if only is not None:
        pattern = only if any(c in only for c in "*?[") else f"*{only}*"
        mutants = [mutant for mutant in mutants if fnmatch.fnmatchcase(mutant.id, pattern)]
        if not mutants:
            raise Usage(f"no mutant matches {only!r}")
    chosen = sample(mutants, limit or None)
    of = matrix.Matrix([loaded[name] for name in names], cells=CELLS, sparing=sparing)
    rows, complete = of.run(chosen, jobs, notify)
    entries = [
        MatrixEntry(
            id=row.mutant.id,
            change=row.mutant.change,
            kills=row.kills,
            unfinished=dict(row.unfinished),
        )
        for row in rows
    ]
    problems = []
    if complete and not (cfgs or only or limit):
        problems = matrix_page.problems(entries, matrix_page.reasons())
    changed = {name: dict(c.constants) for name, c in matrix.CHANGED.items() if name in names}
    head = Head(models=names, changed=changed, states=matrix.STATES)
    return MatrixReport(head, entries, complete, problems)


def as_dict(report: MatrixReport) -> dict[str, Any]:
    """The report as JSON."""
    return {
        "complete": report.complete,
        **report.head.model_dump(),
        "problems": report.problems,
        "mutants": [entry.model_dump() for entry in report.entries],
    }


def show(report: MatrixReport, console: Console) -> None:
    """Print the numbers, the mutants that no property kills, and the problems."""
    killed = Counter(id_ for entry in report.entries for id_ in entry.kills)
    console.print(
        "Killed by: " + ", ".join(f"{id_} {n}" for id_, n in killed.items()), soft_wrap=True
    )
    if report.complete:
        for entry in report.entries:
            if not entry.properties:
                ends = "".join(f" ({end} in {unit})" for unit, end in entry.unfinished.items())
                found = " (oracle)" if entry.kills else ""
                line = f"No property {entry.id}{found}{ends}: {escape(entry.change)}"
                console.print(line, soft_wrap=True)
    for text in report.problems:
        console.print(f"[red]Problem[/]     {escape(text)}", soft_wrap=True)
    if not report.complete:
        console.print("Incomplete; repeat the command to continue")


def write(report: MatrixReport) -> None:
    """Write the matrix of a complete report, from which the page is built."""
    if report.complete:
        files.write(matrix_page.MATRIX, matrix_page.text(report.head, report.entries))
