"""A certificate of the suite: every mutant is killed by a case, or is equivalent on the graphs.

Results are kept in ``decided.jsonl`` in the folder, so that an interrupted run continues.  An edit
of the suite, of the specification or of the mutant invalidates a result.
"""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from multiprocessing.pool import Pool
from pathlib import Path
from subprocess import SubprocessError
from time import monotonic
from typing import Any, Literal

import automcm_conformance
from automcm_conformance.adapter.kit_paths import SUITE
from automcm_conformance.adapter.process import LIMIT_S
from automcm_conformance.suite import purposes
from automcm_conformance.suite.suite_run import Graphs
from automcm_maintenance.code_mutation import cpp_station, equivalence, faults, suite_kills
from automcm_maintenance.code_mutation.equivalence import (
    WALKS,
    Difference,
    EquivalenceError,
    FirstDifference,
)
from automcm_maintenance.code_mutation.faults import Fault
from automcm_maintenance.code_mutation.mutated_process import NO_IMPORT
from automcm_maintenance.code_mutation.source_mutants import (
    REFERENCE,
    SPECIFICATION,
    Generated,
    SourceMutant,
)
from automcm_maintenance.code_mutation.suite_kills import Kills
from automcm_spec.graph.oracle_generation import spec_hash
from automcm_spec.support import children, files, scratch

Notify = Callable[[str], None]
Verdict = Literal["killed", "equivalent", "survived", "undecided", "invalid"]
FORMAT = "automcm.certificate/1"
HIDDEN = "its stored state differs, but its outputs never do"
SMALL, MIDDLE = (("forms", 0), ("tight", 0)), (("one-peer", 0),)
"""The graphs before the suite: SMALL for every mutant, MIDDLE for those that do not differ on
SMALL."""
UNTIL_S = 1_800.0
"""Time limit of the suite for one mutant, in seconds of real time."""


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


@dataclass
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

    @property
    def decided(self) -> bool:
        """Whether no further run can change the verdict."""
        return self.verdict != "undecided"

    def as_dict(self) -> dict[str, object]:
        """The row for the file."""
        return {"class" if k == "class_" else k: v for k, v in asdict(self).items()}

    @classmethod
    def of(cls, row: dict[str, Any]) -> MutantRow:
        """The row of ``as_dict``."""
        given = {"class_" if k == "class" else k: v for k, v in row.items()}
        found = given.pop("difference")
        return cls(**given, difference=Difference(**found) if found else None)


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

    def counts(self, rows: Sequence[MutantRow] | None = None) -> Counter[str]:
        """The number of mutants with each verdict."""
        return Counter(row.verdict for row in (self.rows if rows is None else rows))

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
        return 1 if self.counts()["survived"] or self.counts()["undecided"] else 0

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
            "counts": dict(sorted(self.counts().items())),
            **{"notes": self.notes, "problems": self.problems},
            "mutants": [row.as_dict() for row in self.rows],
        }


# -- in a worker


@dataclass(frozen=True)
class _Job:
    """A mutant of the reference, for a worker, and what the comparisons so far have ``found``: a
    difference, none, or an ``error`` that ended one."""

    mutant: SourceMutant
    asked: CertificateRun
    found: FirstDifference | None = None
    error: str = ""

    @property
    def same(self) -> bool:
        """Whether it may be equivalent."""
        return self.found is None and not self.error


class _Worker:
    """The data that a worker process reads once."""

    graphs: Graphs

    @classmethod
    def start(cls) -> None:
        children.end_with_parent()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent terminates this process
        signal.signal(signal.SIGTERM, _end)
        cls.graphs = Graphs.load(spec_hash(), shared=True)


def _end(*_: object) -> None:
    raise SystemExit(1)


def _compared(job: _Job, source: Path, walks: Sequence[tuple[str, int]]) -> _Job:
    """The job after a comparison of the mutant, whose ``source`` is a file, on these graphs."""
    walks = [walk for walk in job.asked.walks if walk in walks]
    try:
        found = equivalence.first_difference(job.mutant, source, job.asked.folder, walks)
        return replace(job, found=found)
    except (EquivalenceError, OSError) as error:
        return replace(job, error=str(error))


def _write(mutant: SourceMutant, folder: Path) -> Path:
    """The file of a mutant's source."""
    source = folder / f"{mutant.module}.py"
    source.write_text(mutant.source, encoding="utf-8")
    return source


def _look(job: _Job) -> _Job:
    """Compare a mutant on the small graphs."""
    with scratch.folder("certify") as folder:
        return _compared(job, _write(job.mutant, folder), SMALL)


def _work(job: _Job) -> MutantRow:
    """Hold the suite against a mutant, first with the cases that should find its difference.  What
    it does not kill, and does not differ so far, is compared on the other graphs."""
    m, asked = job.mutant, job.asked
    row = MutantRow(m.id, m.class_, m.file, m.line, m.rule, m.old, m.new)
    with scratch.folder("certify") as folder:
        source = _write(m, folder)
        if job.same:
            job = _compared(job, source, MIDDLE)
        child = "automcm_maintenance.code_mutation.mutated_process"
        command = [sys.executable, "-m", child, m.module, str(source)]
        try:
            hint = equivalence.hint(job.found, _Worker.graphs.owners) if job.found else set()
            _set_verdict(row, killed(command, asked, folder, sorted(hint)))
            if row.verdict == "survived":
                _explain(row, job, source)
        except (EquivalenceError, OSError) as error:
            row.verdict, row.why = "undecided", str(error)
    return row


def _explain(row: MutantRow, job: _Job, source: Path) -> None:
    """The verdict of a mutant that the suite does not kill.  Raises WalkError."""
    if job.same:
        others = [walk for walk in job.asked.walks if walk not in SMALL + MIDDLE]
        job = _compared(job, source, others)
    if job.found is None:
        row.verdict, row.why = ("undecided", job.error) if job.error else ("equivalent", "")
        return
    if equivalence.hidden(job.mutant, source, job.asked.walks):
        row.verdict, row.why = "equivalent", HIDDEN
    else:
        row.difference = equivalence.shown(job.mutant, source, job.found)


def _work_cpp(job: tuple[Fault, CertificateRun]) -> tuple[str, Kills | None, str]:
    """Hold the suite against a mutant of the C++ station: its name, what kills it (None: it could
    not be built), and an error."""
    mutant, asked = job
    with scratch.folder("certify") as folder:
        try:
            station = cpp_station.build_mutant(mutant, folder)
            return mutant.name, killed([str(station)], asked, folder, mutant.notice["rules"]), ""
        except (SubprocessError, OSError) as error:
            return mutant.name, None, f"{error} {getattr(error, 'stderr', None) or ''}"


def killed(
    command: Sequence[str], asked: CertificateRun, folder: Path, first: Sequence[str] = ()
) -> Kills:
    """Hold the suite against one station: first the cases that ``first`` selects; if none of these
    fails, the quick part of all cases, and then the whole suite.  Only the quick part, if asked.
    """
    chosen = purposes.select(purposes.load(), asked.selectors)
    likely = [p for p in chosen if p.id in first or set(p.rules) & set(first)]
    likely = likely if asked.cases else []
    found, due = Kills(), monotonic() + UNTIL_S
    parts = [(likely, False)] if likely else []
    parts += [(chosen, True)] if asked.cases else []
    for part, quick in [(chosen, True)] if asked.quick else [*parts, (chosen, False)]:
        found = suite_kills.kills(
            command,
            _Worker.graphs,
            part,
            folder,
            enough=asked.cases,
            seed=asked.seed,
            limit_s=LIMIT_S,
            until_s=due - monotonic(),
            brief=part is likely,
            quick=quick,
        )
        if found.unstarted is not None or found.cases:
            break
    return found


# -- the run


def run(
    mutants: Sequence[SourceMutant], asked: CertificateRun, notify: Notify
) -> tuple[list[MutantRow], list[str]]:
    """Judge these mutants of the reference: the rows, in their order, and the problems.

    Interrupted, it returns what is decided.  Raises WalkError, OSError, OracleError.
    """
    files.folder(asked.folder, named=True)
    for unfinished in asked.folder.glob(".*.new"):  # of a run that was killed
        unfinished.unlink()
    kept = _Kept(asked)
    rows: dict[str, MutantRow] = {}
    problems: list[str] = []
    for mutant in mutants:
        row = kept.row(mutant.id, mutant.source)
        if row is not None and row.decided:
            rows[mutant.id] = row
    left = [mutant for mutant in mutants if mutant.id not in rows]
    try:
        if left:
            with _processes(asked) as pool:
                _judge(left, asked, pool, rows, kept, notify)
    except KeyboardInterrupt:
        problems.append("interrupted")
    found = [rows[mutant.id] for mutant in mutants if mutant.id in rows]
    return [row for row in found if row.decided or not problems], problems


def run_cpp(asked: CertificateRun, notify: Notify) -> tuple[list[MutantRow], list[str]]:
    """Judge the mutants of the C++ station: as ``run``.  Raises ValueError for a bad file."""
    files.folder(asked.folder, named=True)
    kept, mutants = _Kept(asked), list(faults.load("cpp").values())
    rows: dict[str, MutantRow] = {}
    left = []
    problems: list[str] = []
    texts = (path for path in sorted(cpp_station.SOURCE.iterdir()) if path.is_file())
    sources = "".join(path.read_text(encoding="utf-8") for path in texts)
    header = (cpp_station.SOURCE / "station.hpp").read_text(encoding="utf-8")
    for m in mutants:
        line = header[: header.index(m.edits[0].old)].count("\n") + 1
        file = "conformance/implementations/cpp/station.hpp"
        row = MutantRow(
            f"cpp/{m.name}", "station", file, line, m.notice["rules"][0], m.story, "", "cpp"
        )
        known = kept.row(row.id, f"{sources}{m.edits}")
        rows[row.id] = known if known is not None and known.decided else row
        left += [(m, asked)] if rows[row.id] is row else []
    try:
        with _processes(asked) as pool:
            for n, (name, kills, error) in enumerate(pool.imap_unordered(_work_cpp, left)):
                notify(f"the C++ station: {n + 1} of {len(left)}")
                row = rows[f"cpp/{name}"]
                if kills is not None:
                    _set_verdict(row, kills)
                row.why = row.why or error
                (edits,) = [m.edits for m in mutants if m.name == name]
                kept.keep(f"{sources}{edits}", row, rows)
    except KeyboardInterrupt:
        problems.append("interrupted")
    return [row for row in rows.values() if row.decided or not problems], problems


@contextmanager
def _processes(asked: CertificateRun) -> Iterator[Pool]:
    pool = multiprocessing.get_context("spawn").Pool(asked.jobs, _Worker.start)
    try:
        yield pool
    finally:
        pool.terminate()
        pool.join()


def _judge(
    mutants: Sequence[SourceMutant],
    asked: CertificateRun,
    pool: Pool,
    rows: dict[str, MutantRow],
    kept: _Kept,
    notify: Notify,
) -> None:
    """Judge these mutants.  Those that may be equivalent come first, because they take minutes;
    of these, those that any input can reach."""
    for walk in asked.walks:
        if walk in SMALL:
            notify(f"the reference itself on {walk[0]}")
            equivalence.digests(asked.folder, walk)
    others = [walk for walk in reversed(asked.walks) if walk not in SMALL]
    write = partial(pool.map_async, partial(equivalence.digests, asked.folder), others, 1)
    beside = write() if len(mutants) > asked.jobs else None  # few may not need them
    jobs = []
    for job in pool.imap_unordered(_look, [_Job(mutant, asked) for mutant in mutants]):
        jobs.append(job)
        notify(f"a first look: {len(jobs)} of {len(mutants)} mutants")
    if beside is None and any(job.same for job in jobs):
        beside = write()
    if beside is not None:
        beside.get()
    jobs.sort(key=lambda job: (not job.same, bool(equivalence.kinds_of(job.mutant)), job.mutant.id))
    sources = {mutant.id: mutant.source for mutant in mutants}
    not_killed = 0
    for n, row in enumerate(pool.imap_unordered(_work, jobs), 1):
        not_killed += row.verdict not in ("killed", "invalid")
        notify(f"{n} of {len(mutants)} mutants, {not_killed} not killed")
        kept.keep(sources[row.id], row, rows)


def _set_verdict(row: MutantRow, kills: Kills) -> None:
    """Set the verdict of a mutant from the suite's result."""
    row.cases, row.why = kills.cases, kills.what
    if kills.unstarted == NO_IMPORT:
        row.verdict = "invalid"
    elif kills.cases or kills.unstarted is not None:
        row.verdict = "killed"
    else:
        row.verdict = "undecided" if kills.late else "survived"


class _Kept:
    """Earlier results with the same suite."""

    def __init__(self, asked: CertificateRun) -> None:
        self.path = asked.folder / "decided.jsonl"
        self.suite = suite_hash(asked)
        self.known: dict[str, Any] = {}
        if self.path.exists():
            data = self.path.read_bytes()
            whole = data[: data.rfind(b"\n") + 1]
            if whole != data:  # a run was killed as it wrote
                os.truncate(self.path, len(whole))
            for line in whole.splitlines():
                entry = json.loads(line)
                self.known[entry["key"]] = entry["row"]

    def _key(self, id_: str, source: str) -> str:
        return hashlib.sha256(f"{self.suite}{id_}{source}".encode()).hexdigest()

    def row(self, id_: str, source: str) -> MutantRow | None:
        """The earlier result of a mutant."""
        entry = self.known.get(self._key(id_, source))
        if entry is None:
            return None
        difference = entry.pop("difference")
        row = MutantRow(class_=entry.pop("class"), **entry)
        row.difference = None if difference is None else Difference(**difference)
        return row

    def keep(self, source: str, row: MutantRow, rows: dict[str, MutantRow]) -> None:
        rows[row.id] = row
        with self.path.open("a", encoding="utf-8") as out:
            key = self._key(row.id, source)
            out.write(json.dumps({"key": key, "row": row.as_dict()}) + "\n")


def suite_hash(asked: CertificateRun) -> str:
    """A hash of all that a verdict depends on, except the mutant."""
    of = f"{spec_hash()} {asked.seed} {asked.cases} {asked.selectors} {asked.walks}"
    of += f" {[part.name for part in fields(MutantRow)]}"
    found = hashlib.sha256((of + " quick" * asked.quick).encode())
    folders = (Path(automcm_conformance.__path__[0]), REFERENCE, SPECIFICATION, SUITE)
    for folder in folders:
        for path in sorted(path for path in folder.rglob("*") if path.suffix in (".py", ".toml")):
            found.update(path.read_bytes())
    for path in (*equivalence.FILES, Path(suite_kills.__file__), Path(__file__)):
        found.update(path.read_bytes())
    return found.hexdigest()
