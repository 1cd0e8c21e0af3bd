"""``automcm spec prove``: proves the obligations of Inductive.tla and formats the report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console

from automcm_cli.shared.common import table_of, unknown
from automcm_maintenance.compilation import sany
from automcm_spec.model_checking.tlc import TlcError
from automcm_spec.support.collection import uncollected

if TYPE_CHECKING:
    from automcm_maintenance.induction.proof import ProofResult


class MissingProver(Exception):
    """The package of the extra ``prove`` is not installed."""


MODULE = "Inductive"
"""The module with the invariant."""
FAULTS = (MissingProver, TlcError, sany.NotCompiled, OSError)
"""Errors that end a run with exit code 3."""
ONE_STATE = "one state"
"""The place of obligations that are about no step."""


@dataclass(frozen=True)
class ProofReport:
    """The results of all obligations."""

    results: Sequence[ProofResult]

    @property
    def open(self) -> list[ProofResult]:
        """The obligations that are not proved."""
        return [r for r in self.results if r.verdict != "proved"]

    @property
    def exit_code(self) -> int:
        """0: all are proved; 1: one is refuted; 4: z3 cannot tell."""
        verdicts = {r.verdict for r in self.open}
        return 1 if "refuted" in verdicts else 4 if verdicts else 0

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON."""
        rows = [{**r._asdict(), "uses": sorted(r.uses)} for r in self.results]
        return {"proved": not self.open, "obligations": rows}


def run(without: Sequence[str], step: str, notify: Callable[[str], None]) -> ProofReport:
    """Prove the obligations of the steps whose name contains ``step``; "" means all."""
    if find_spec("z3") is None:
        raise MissingProver("z3-solver is not installed: pip install 'automcm[prove]'")
    from automcm_maintenance.induction.proof import Prover

    notify("reading the specification")
    spec = sany.read(sany.export(MODULE))
    known = Prover(spec).conjuncts
    for name in without:
        if name not in known:
            raise typer.BadParameter(unknown(name, known, "conjunct of the invariant"))
    results: list[ProofResult] = []
    with uncollected():
        for result in Prover(spec, frozenset(without)).results(step):
            results.append(result)
            notify(f"{len(results)} obligations; {result.step or ONE_STATE}: {result.goal}")
    if not results:
        raise typer.BadParameter(f"no step has {step!r} in its name")
    return ProofReport(results)


def unproved(r: ProofResult) -> str:
    """An obligation that is not proved."""
    return f"{r.verdict}: {r.goal} after {r.step or ONE_STATE}"


def show(report: ProofReport, console: Console) -> None:
    """Print a line for each goal, and each obligation that is not proved."""
    table = table_of("goal", "obligations", "proved", "seconds")
    asked = Counter(r.goal for r in report.results)
    for goal, n in asked.items():
        mine = [r for r in report.results if r.goal == goal]
        proved = sum(r.verdict == "proved" for r in mine)
        table.add_row(goal, str(n), str(proved), f"{sum(r.seconds for r in mine):.1f}")
    console.print(table)
    for r in report.open:
        console.print(unproved(r), markup=False)
    proved = len(report.results) - len(report.open)
    console.print(f"{proved} of {len(report.results)} obligations are proved.")
