"""The certificate in words: on the screen, and as a page of the site."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from automcm_maintenance.code_mutation.certificate import (
    CertificateRun,
    KillCertificate,
    MutantRow,
    Verdict,
    suite_hash,
)
from automcm_maintenance.documents.repository import PAGES, ROOT, markdown_table
from automcm_spec.support import files, templates

RESULTS = ROOT / "conformance" / "certificate.json"
STALE = "the kit, the reference, the specification or the log checker have changed since the run"
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
MEANING = {
    "table": "a row of a table of rules or phases is dropped, changed or moved",
    "guard": "a condition is negated, loses a part, or compares differently",
    "timer": "a timer is not armed, stopped or re-armed, has a wrong duration, or is out of order",
    "field": "a value in a message or indication is replaced, off by one, or dropped",
    "memory": "a value is not stored, not forgotten, or not retransmitted",
    "form": "a validity check of a message is dropped or changed",
    "station": "a hand-written fault in the C++ station",
}
LONGEST = 110
"""Maximum characters of a change in the table; the JSON report contains the complete text."""


def summary(found: KillCertificate) -> str:
    """The text for the screen: counts, and the mutants that were not killed."""
    lines = [_counted(*row) for row in (*_by_class(found.rows), ("all", found.rows))]
    for row in found.rows:
        if row.verdict in ("survived", "undecided"):
            lines += ["", *survivor(row)]
    lines += [f"SKIPPED: {note}" for note in found.notes]
    lines += [f"Problem: {problem}" for problem in found.problems]
    if not found.complete:
        lines.append(
            f"Incomplete: {len(found.rows)} of {found.chosen}; repeat the command to continue"
        )
    return "\n".join(lines)


def survivor(row: MutantRow) -> list[str]:
    """The data for a new case that kills this mutant."""
    lines = [f"{row.verdict} {row.id} ({row.file}:{row.line}, {row.rule})"]
    lines.append(f"  {row.old}  =>  {row.new}")
    if row.why:
        lines.append(f"  {row.why}")
    if row.difference is not None:
        d = row.difference
        lines.append(f"  graph {d.graph}, state {d.state}")
        lines.append(f"  input {d.input}")
        lines += [f"  right {d.right}", f"  wrong {d.wrong}"]
    return lines


def _counted(name: str, rows: Sequence[MutantRow]) -> str:
    counts = Counter(row.verdict for row in rows)
    counted = ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict])
    return f"{name:>8} {len(rows):>4}: {counted}"


def _by_class(rows: Sequence[MutantRow]) -> list[tuple[str, list[MutantRow]]]:
    of = {name: [row for row in rows if row.class_ == name] for name in MEANING}
    return [(name, found) for name, found in of.items() if found]


def write(found: KillCertificate) -> None:
    """Write the results that the page is built from, if the certificate is complete."""
    if found.complete:
        made = {"inputs": suite_hash(found.asked)} | found.as_dict()
        files.write(RESULTS, f"{json.dumps(made, indent=1, ensure_ascii=False)}\n")


def load() -> dict[str, Any]:
    """What ``write`` wrote.  Raises OSError, ValueError."""
    found: dict[str, Any] = json.loads(RESULTS.read_bytes())
    return found


def stale(found: dict[str, Any]) -> bool:
    """Whether what the verdicts depend on has changed since the run."""
    selectors = tuple(found["selectors"])
    asked = CertificateRun(Path(), found["seed"], found["cases"], selectors)
    return bool(found["inputs"] != suite_hash(asked))


def markdown(found: dict[str, Any]) -> str:
    """The page of what ``write`` wrote."""
    made = [MutantRow.of(row) for row in found["mutants"]]
    classes = _by_class(made)
    groups = sorted({case.split("/")[2] for row in made for case in row.cases})
    rows: list[list[object]] = []
    for name, of in classes:
        hit = Counter(group for row in of for group in {case.split("/")[2] for case in row.cases})
        rows.append([name, len(of), *(hit[group] or "" for group in groups)])
    mutants = [
        [f"`{row.id}`", row.line, row.rule, f"`{_change(row)}`", _killers(row)] for row in made
    ]
    heads = ["mutant", "line", "rule", "change", "killed by"]
    return templates.page(
        PAGES / "certificate.md.j2",
        found=found,
        stale=STALE if stale(found) else "",
        cpp=sum(row.station == "cpp" for row in made),
        many="one failed case" if found["cases"] == 1 else f"{found['cases']} failed cases",
        counts=markdown_table(
            ["class", "mutants", *VERDICTS, "fault"],
            [_counts(*row) for row in (*classes, ("all", made))],
        ),
        matrix=markdown_table(["class", "mutants", *groups], rows),
        survivors=[row for row in made if row.verdict in ("survived", "undecided")],
        survivor=survivor,
        mutants=markdown_table(heads, mutants, heads[2:]),
    )


def _counts(name: str, of: Sequence[MutantRow]) -> list[object]:
    counts = Counter(row.verdict for row in of)
    return [name, len(of), *(counts[v] for v in VERDICTS), MEANING.get(name, "")]


def _change(row: MutantRow) -> str:
    text = f"{row.old}  =>  {row.new}" if row.new else row.old
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"


def _killers(row: MutantRow) -> str:
    if row.verdict != "killed":
        return f"*{row.verdict}*"
    return ", ".join(case.removeprefix("AMCM/") for case in row.cases) or "does not start"
