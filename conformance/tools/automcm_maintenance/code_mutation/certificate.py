"""A certificate of the suite: every mutant is killed by a case, or is equivalent on the graphs.

Each result is a file in the folder, so that an interrupted run continues.  An edit of the suite, of
the specification or of the mutant invalidates a result.
"""

from __future__ import annotations

import ast
import hashlib
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from pathlib import Path
from subprocess import SubprocessError
from typing import Any, Literal

import pydantic

import automcm_conformance
from automcm_conformance.adapter.kit_paths import SUITE
from automcm_conformance.adapter.process import LIMIT_S, AdapterError
from automcm_conformance.adapter.protocol import ProtocolError
from automcm_conformance.exchange.results import INTERRUPTED
from automcm_conformance.suite import purposes
from automcm_conformance.suite.suite_run import conform
from automcm_evaluation.framework.experiment import ExperimentError, Values
from automcm_evaluation.sweeps import sweep
from automcm_maintenance.code_mutation import cpp_station, equivalence, faults
from automcm_maintenance.code_mutation.equivalence import WALKS, EquivalenceError
from automcm_maintenance.code_mutation.lockstep import Difference
from automcm_maintenance.code_mutation.mutated_process import NO_IMPORT
from automcm_maintenance.code_mutation.source_mutants import (
    MODULES,
    REFERENCE,
    SPECIFICATION,
    Generated,
    SourceMutant,
    path_of,
)
from automcm_spec.graph.oracle_generation import spec_hash
from automcm_spec.support import scratch
from automcm_traces import checker, system

Notify = Callable[[str], None]
Verdict = Literal["killed", "equivalent", "survived", "undecided", "invalid"]
FORMAT = "automcm.certificate/1"


@dataclass(frozen=True)
class CertificateRun:
    """The settings of a run.  A mutant's run stops after ``cases`` failed cases (0 = never).
    ``selectors`` select a part of the suite (all without any), ``quick`` that of ``conform run
    --quick``."""

    folder: Path
    seed: int = 1
    cases: int = 3
    selectors: tuple[str, ...] = ()
    jobs: int = 2
    quick: bool = False
    walks: tuple[tuple[str, int], ...] = WALKS


@pydantic.dataclasses.dataclass
class MutantRow:
    """The result for a mutant: the ``cases`` that kill it, the ``difference`` of a survivor from
    the reference, or another explanation ``why``."""

    id: str
    class_: str
    file: str
    line: int
    rule: str
    old: str
    new: str
    station: str = "reference"
    verdict: Verdict = "undecided"
    cases: list[str] = field(default_factory=list)
    why: str = ""
    difference: Difference | None = None

    def as_dict(self) -> dict[str, object]:
        """The row for the file."""
        return {"class" if k == "class_" else k: v for k, v in asdict(self).items()}

    @classmethod
    def of(cls, row: dict[str, Any]) -> MutantRow:
        """The row of ``as_dict``."""
        return cls(**{"class_" if k == "class" else k: v for k, v in row.items()})


@dataclass
class KillCertificate:
    """A run.  ``chosen`` of the mutants ``made`` were selected."""

    asked: CertificateRun
    spec_hash: str
    made: Generated
    chosen: int
    rows: list[MutantRow] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    """Problems of the run itself."""

    @property
    def counts(self) -> Counter[str]:
        """The number of mutants with each verdict."""
        return Counter(row.verdict for row in self.rows)

    @property
    def complete(self) -> bool:
        """Whether every selected mutant is decided."""
        return not self.problems and len(self.rows) == self.chosen

    @property
    def exit_code(self) -> int:
        """0: all are killed or equivalent; 1: some survive or are undecided; 3: the run failed or
        is not complete."""
        if not self.complete:
            return 3
        return 1 if self.counts["survived"] or self.counts["undecided"] else 0

    def as_dict(self) -> dict[str, object]:
        """The report for ``--json``; equal bytes in each run with the same seed."""
        return {
            "format": FORMAT,
            "seed": self.asked.seed,
            "cases": self.asked.cases,
            "selectors": list(self.asked.selectors),
            "spec_hash": self.spec_hash,
            "generated": len(self.made.mutants),
            "broken": self.made.broken,
            "chosen": self.chosen,
            "complete": self.complete,
            "exit_code": self.exit_code,
            "counts": dict(sorted(self.counts.items())),
            **{"notes": self.notes, "problems": self.problems},
            "mutants": [row.as_dict() for row in self.rows],
        }


# -- one mutant, in any process


def _judge(asked: CertificateRun, values: Values) -> Values:
    """The row of a mutant of the reference: hold the suite against it.  What it does not kill is
    compared on the graphs."""
    m = SourceMutant(**values)
    row = MutantRow(m.id, m.class_, m.file, m.line, m.rule, m.old, m.new)
    with scratch.folder("certify") as folder:
        source = folder / f"{m.module}.py"
        source.write_text(m.source, encoding="utf-8")
        child = "automcm_maintenance.code_mutation.mutated_process"
        _hold(row, [sys.executable, "-m", child, m.module, str(source)], asked, folder)
        if row.verdict == "survived":
            try:
                row.difference = equivalence.first_difference(
                    m, source, asked.walks, asked.folder / "answers"
                )
                row.verdict = "survived" if row.difference else "equivalent"
            except (EquivalenceError, OSError) as ended:
                row.verdict, row.why = "undecided", str(ended)
    return row.as_dict()


def _judge_cpp(asked: CertificateRun, values: Values) -> Values:
    """The row of a mutant of the C++ station; it is undecided if it cannot be built."""
    mutant = faults.load("cpp")[values["cpp"]]
    (path,) = mutant.texts()
    line = path.read_text(encoding="utf-8").partition(mutant.edits[0].old)[0].count("\n") + 1
    file, rules = str(path.relative_to(faults.ROOT)), mutant.notice["rules"]
    row = MutantRow(f"cpp/{mutant.name}", "station", file, line, rules[0], mutant.story, "", "cpp")
    with scratch.folder("certify") as folder:
        try:
            station = cpp_station.build_mutant(mutant, folder)
            _hold(row, [str(station)], asked, folder)
        except (SubprocessError, OSError) as error:
            row.why = f"{error} {getattr(error, 'stderr', None) or ''}"
    return row.as_dict()


def _hold(row: MutantRow, command: Sequence[str], asked: CertificateRun, folder: Path) -> None:
    """Hold the suite against one station, first its quick part, and set the verdict."""
    chosen = purposes.select(purposes.load(), asked.selectors)
    for quick in [True] if asked.quick else [True, False] if asked.cases else [False]:
        try:
            found = conform(
                command,
                chosen,
                folder,
                limit_s=LIMIT_S,
                seed=asked.seed,
                notify=lambda _: None,
                selectors=asked.selectors,
                expected={},
                stop_after=asked.cases,
                quick=quick,
            )
        except (AdapterError, ProtocolError) as error:
            no_mutant = getattr(error, "exit_code", None) == NO_IMPORT
            row.verdict, row.why = "invalid" if no_mutant else "killed", str(error)
            return
        if INTERRUPTED in found.notes:
            raise KeyboardInterrupt
        if found.broke:
            row.why = "; ".join(found.problems)
            return
        if failed := [case for case in found.cases if case.verdict in ("FAIL", "ERROR")]:
            first = failed[0]
            row.verdict, row.cases = "killed", [case.id for case in failed]
            row.why = first.failures[0].what if first.failures else first.reason
            return
    row.verdict = "survived"


# -- the run


def run(
    mutants: Sequence[SourceMutant], asked: CertificateRun, notify: Notify
) -> tuple[list[MutantRow], list[str]]:
    """Judge these mutants of the reference: the rows, in their order, and the problems.

    Interrupted, it returns what is decided.  Raises OSError, OracleError.
    """
    return _finished([asdict(mutant) for mutant in mutants], _judge, asked, notify)


def run_cpp(asked: CertificateRun, notify: Notify) -> tuple[list[MutantRow], list[str]]:
    """Judge the mutants of the C++ station: as ``run``."""
    return _finished([{"cpp": name} for name in faults.load("cpp")], _judge_cpp, asked, notify)


def _finished(
    wanted: list[Values],
    judge: Callable[[CertificateRun, Values], Values],
    asked: CertificateRun,
    notify: Notify,
) -> tuple[list[MutantRow], list[str]]:
    of, problems = {"suite": suite_hash(asked)}, []

    def progress(done: int, of: int) -> None:
        notify(f"{done} of {of} mutants")

    try:
        judged = partial(judge, asked)
        sweep.finish(wanted, judged, of, asked.folder, workers=asked.jobs, notify=progress)
    except KeyboardInterrupt:
        problems.append("interrupted")
    except ExperimentError as error:
        problems.append(str(error))
    rows = []
    for path, cell in sweep.finished(wanted, of, asked.folder):
        row = MutantRow.of(cell.result)
        decided = row.verdict != "undecided"
        if not decided:
            path.unlink()  # so that the next run judges it again
        if decided or not problems:
            rows.append(row)
    return rows, problems


SUFFIXES = ".py", ".toml", ".hpp", ".cpp"


def _code(path: Path) -> bytes:
    """A file, without the text of docstrings, on which no verdict depends."""
    source = path.read_bytes()
    lines = source.split(b"\n")
    nodes = ast.walk(ast.parse(source if path.suffix == ".py" else ""))
    texts = [n for n in nodes if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)]
    for node in sorted(texts, key=lambda node: -node.lineno):
        part = slice(node.lineno - 1, node.end_lineno)
        text = b"\n".join(lines[part]).strip()
        if text.startswith(b'"""') and text.endswith(b'"""') and text.count(b'"""') == 2:
            lines[part] = [b'"""']
    return b"\n".join(lines)


def suite_hash(asked: CertificateRun) -> str:
    """A hash of all that a verdict depends on, except the mutant."""
    of = f"{spec_hash()} {asked.seed} {asked.cases} {asked.selectors} {asked.walks}"
    of += f" {[part.name for part in fields(MutantRow)]}"
    found = hashlib.sha256((of + " quick" * asked.quick).encode())
    judges = (Path(judge.__path__[0]) for judge in (automcm_conformance, checker, system))
    folders = *judges, REFERENCE, SPECIFICATION, SUITE, cpp_station.SOURCE, faults.CATALOGUES
    for folder in folders:
        for path in sorted(path for path in folder.rglob("*") if path.suffix in SUFFIXES):
            found.update(_code(path))
    for path in (*equivalence.FILES, Path(__file__)):
        found.update(_code(path))
    for name in MODULES:  # a mutant is a whole module
        found.update(path_of(name).read_bytes())
    return found.hexdigest()
