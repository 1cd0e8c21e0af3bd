"""``automcm spec mutate``: selects mutants, runs them and formats the report."""

from __future__ import annotations

import fnmatch
import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from automcm_maintenance.documents import matrix_page
from automcm_maintenance.documents.repository import PAGES, ROOT, markdown_table
from automcm_maintenance.spec_mutation import mutant_runs, survivors
from automcm_maintenance.spec_mutation.mutant_rules import KINDS, MODULES, NOT_MUTATED
from automcm_maintenance.spec_mutation.mutant_runs import (
    HOW,
    MutantOutcome,
    MutationError,
    MutationReport,
    Profile,
)
from automcm_maintenance.spec_mutation.mutants import MissingPackage, Mutant, generate, sample
from automcm_maintenance.spec_mutation.survivors import SURVIVORS
from automcm_spec.model_checking import models
from automcm_spec.support import files
from automcm_spec.support import markdown as markdown_
from automcm_spec.support.paths import TLA

CACHE = ROOT / "runs" / "mutation.jsonl"
RESULTS = ROOT / "spec" / "mutation" / "results.json"
PROFILES: tuple[str, ...] = get_args(Profile)
_RECORDS = "counts"


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
    search_s: float
    longest_s: float
    page: bool

    def __post_init__(self) -> None:
        if self.profile not in PROFILES:
            raise Usage(f"--profile must be one of {', '.join(PROFILES)}, not {self.profile!r}")
        if self.page and (self.only or self.modules or self.models):
            raise Usage("--write cannot be combined with --only, --module or --model")
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

    The longer models come last, so that only survivors of the others reach them.  The list of
    survivors is only compared if no models are named.
    """
    loaded = models.load()
    if unknown := set(asked.models or ()) - {model.cfg for model in loaded}:
        raise Usage(f"there is no model {', '.join(sorted(unknown))}")
    usual = [m for m in models.of_profile(loaded, "full") if m.seconds <= asked.longest_s]
    chosen = [m for m in loaded if m.cfg in asked.models] if asked.models else usual
    modules, known = asked.modules or MODULES, survivors.load()
    report = mutant_runs.run(
        mutants,
        chosen,
        profile="deep" if asked.profile == "deep" else "quick",
        cache=CACHE,
        jobs=asked.jobs,
        search_s=asked.search_s,
        notify=notify,
    )
    report.reasons = {id_: entry.reason for id_, entry in known.items()}
    if asked.profile == "quick" and not asked.models:
        report.problems += survivors.compare(report, known, generate(modules=modules), modules)
    return report


def _by_kind(report: MutationReport) -> list[tuple[str, list[MutantOutcome]]]:
    kinds = [(kind, [o for o in report.outcomes if o.mutant.kind == kind]) for kind in KINDS]
    return [*[(kind, found) for kind, found in kinds if found], ("all", report.outcomes)]


def _cells(outcomes: Sequence[MutantOutcome]) -> list[int]:
    """The numbers of mutants, of kills in each way, of survivors and of invalid mutants."""
    killed = [sum(o.how == how for o in outcomes) for how in HOW]
    ends = [sum(o.survived for o in outcomes), sum(o.invalid for o in outcomes)]
    return [len(outcomes), *killed, *ends]


def _head(how: str) -> str:
    return "records" if how == _RECORDS else how


def _heads() -> list[str]:
    return ["mutants", *map(_head, HOW), "survived", "invalid"]


def _per_property(report: MutationReport) -> dict[str, int]:
    killed = Counter(name for o in report.outcomes for name in o.properties)
    return {name: killed[name] for name in sorted({*models.PROPERTIES, *killed})}


def _rates(report: MutationReport) -> tuple[float, float]:
    """The shares of the valid mutants killed, and killed by more than the recorded counts."""
    valid = [o for o in report.outcomes if not o.invalid]
    killed = sum(not o.survived for o in valid)
    by_counts = sum(o.how == _RECORDS for o in valid)
    return killed / max(1, len(valid)), (killed - by_counts) / max(1, len(valid))


def as_dict(report: MutationReport) -> dict[str, Any]:
    """The report as JSON."""
    rate, without_counts = _rates(report)
    rows = []
    for o in report.outcomes:
        row = o.as_dict()
        if o.survived and o.mutant.id in report.reasons:
            row["reason"] = report.reasons[o.mutant.id]
        rows.append(row)
    return {
        "profile": report.profile,
        "complete": report.complete,
        "selected": report.selected,
        "kinds": {
            kind: dict(zip(_heads(), _cells(outcomes), strict=True))
            for kind, outcomes in _by_kind(report)
        },
        "properties": _per_property(report),
        "kill_rate": round(rate, 4),
        "kill_rate_without_records": round(without_counts, 4),
        "problems": report.problems,
        "mutants": rows,
    }


def results(report: MutationReport) -> dict[str, Any]:
    """What the page shows of a report."""
    whole = as_dict(report)
    alive = [o.mutant for o in report.outcomes if o.survived]
    shown = ("profile", "kinds", "kill_rate", "kill_rate_without_records")
    return {name: whole[name] for name in shown} | {
        "survivors": [
            {"id": m.id, "module": m.module, "line": m.line, "change": m.change} for m in alive
        ]
    }


def show(report: MutationReport, console: Console) -> None:
    """Print the tables, the survivors and the problems."""
    table = Table(title="Mutants: how they were killed", title_justify="left", box=None)
    table.add_column("kind", no_wrap=True)
    for name in _heads():
        table.add_column(name, justify="right")
    for kind, outcomes in _by_kind(report):
        table.add_row(kind, *(str(n) if n else "-" for n in _cells(outcomes)))
    console.print(table)
    killed = ", ".join(f"{name} {n}" for name, n in _per_property(report).items())
    first = "" if report.profile == "deep" else " (the first to find a mutant)"
    console.print(f"Killed by property{first}: {killed}", soft_wrap=True)
    console.print(_rate_text(*_rates(report)))
    for o in report.outcomes:
        if not o.survived:
            continue
        m = o.mutant
        console.print(f"Survived    {m.id}  {m.module}.tla:{m.line}", soft_wrap=True)
        console.print(f"            {escape(m.change)}", soft_wrap=True)
        if m.id in report.reasons:
            console.print(f"            {escape(report.reasons[m.id])}", soft_wrap=True)
    for text in report.problems:
        console.print(f"[red]Problem[/]     {escape(text)}", soft_wrap=True)
    if not report.complete:
        done = len(report.outcomes)
        console.print(f"Incomplete: {done} of {report.selected}; repeat the command to continue")


def _rate_text(rate: float, without_counts: float) -> str:
    return f"Killed: {rate:.1%}; without the recorded counts: {without_counts:.1%}"


def markdown(found: dict[str, Any]) -> str:
    """The page: the tables of ``results``, the committed matrix, the survivors."""
    kinds = [[kind, *n.values(), KINDS.get(kind, "")] for kind, n in found["kinds"].items()]
    return markdown_.page(
        PAGES / "mutation.md.j2",
        profile=found["profile"],
        kinds=markdown_table(["kind", *_heads(), "what"], kinds),
        rates=_rate_text(found["kill_rate"], found["kill_rate_without_records"]),
        hows={_head(how): text for how, text in HOW.items()},
        matrix=matrix_page.page_part(),
        survivors=found["survivors"],
        listed=SURVIVORS,
        reasons={id_: entry.reason for id_, entry in survivors.load().items()},
        not_mutated=NOT_MUTATED,
    )


def write(report: MutationReport) -> None:
    """Write the results of a complete report, from which the page is built."""
    if report.complete:
        files.write(RESULTS, json.dumps(results(report), indent=1, ensure_ascii=False) + "\n")
