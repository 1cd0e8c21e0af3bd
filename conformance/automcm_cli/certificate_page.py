"""The certificate in words: on the screen, and as the page docs/certificate.md."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import get_args

from automcm_cli.certificate import Certificate, Row, Verdict
from automcm_cli.common import ROOT, markdown_table
from automcm_spec import files

PAGE = ROOT / "docs" / "certificate.md"
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
MEANING = {
    "table": "a row of a table of rules or phases is dropped, changed, or changes places",
    "guard": "a condition is negated, a part of it dropped, a comparison changed",
    "timer": "a timer is not armed, not stopped, not armed anew, too long or short, out of order",
    "field": "a value in a message or indication is another one, off by one, or dropped",
    "memory": "something is not remembered, not forgotten, or not sent again",
    "form": "a check of the form of a message is left out or another one",
    "station": "a mistake that a programmer made by hand, in the C++ station",
}
LONGEST = 110
"""Characters of a change in the table; the JSON has all."""


def summary(found: Certificate) -> str:
    """A few lines for the screen: counts, and all about what is not killed."""
    lines = [_counted("all", found.rows)]
    lines = [_counted(name, rows) for name, rows in _by_class(found)] + lines
    for row in found.rows:
        if row.verdict in ("survived", "undecided"):
            lines += ["", *survivor(row)]
    lines += [f"SKIPPED: {note}" for note in found.notes]
    lines += [f"Problem: {problem}" for problem in found.problems]
    if not found.complete:
        lines.append(
            f"Incomplete: {len(found.rows)} of {found.chosen}; the same command goes on from here"
        )
    return "\n".join(lines)


def survivor(row: Row) -> list[str]:
    """All that is needed to make a case of it."""
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


def _counted(name: str, rows: Sequence[Row]) -> str:
    counts = Counter(row.verdict for row in rows)
    told = ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS if counts[verdict])
    return f"{name:>8} {len(rows):>4}: {told}"


def _by_class(found: Certificate) -> list[tuple[str, list[Row]]]:
    of = {name: [row for row in found.rows if row.class_ == name] for name in MEANING}
    return [(name, rows) for name, rows in of.items() if rows]


def write(found: Certificate) -> None:
    """Write the page, if the certificate is complete."""
    if found.complete:
        files.write(PAGE, markdown(found))


def markdown(found: Certificate) -> str:
    """The page."""
    many = f"{found.cases} cases" if found.cases != 1 else "one case"
    until = f"until {many} had found it" if found.cases else "whole"
    heads = ["class", "mutants", *VERDICTS, "what"]
    total = ("all", found.rows)
    rows = [
        [name, len(of), *(Counter(row.verdict for row in of)[v] for v in VERDICTS), MEANING[name]]
        for name, of in _by_class(found)
    ]
    counts = found.counts()
    rows.append([total[0], len(total[1]), *(counts[v] for v in VERDICTS), ""])
    return "\n".join(
        [
            "# Certificate of the conformance kit",
            "",
            "Written by `automcm conform certify --page`. The suite is held against stations that "
            "are wrong on purpose, each in one small way; a case must find it.",
            "",
            *markdown_table(heads, rows),
            "",
            f"Of {found.generated:,} mutants that can be generated, {found.chosen:,} were judged, "
            f"chosen by seed {found.seed} in turn from each class and each function; each run of "
            f"the suite went on {until}. Specification {found.spec_hash[:12]}.",
            "",
            *(f"**SKIPPED**: {note}\n" for note in found.notes),
            "- *killed*: at least one case is FAIL or ERROR. No exploration takes part.",
            "- *equivalent*: no case finds it, and at every state of the graphs `one-peer`, "
            "`two-peers` and `tight` every input has the same answer as without the change: "
            "messages with all fields, indications, the whole state that is kept, timers with "
            "their deadlines. So has an input when all timers are due at once, bytes that are no "
            "message, and time that goes back; in `one-peer` and `tight` with three sets of "
            "parameters. The rule and detail of an indication are not compared: they explain, "
            "and any are right. Of inputs for which the changed function cannot be called none is "
            "given. And of some 13,000 messages with one thing odd (a field that is missing, of "
            "another kind, at a bound and beyond it) each is refused or taken as without the "
            "change. A mutant that differs only in what it keeps is led on, beside the unchanged "
            "reference: what differs is carried from state to state as long as that is new, and "
            "all inputs are given to both. If what they say, with all deadlines, is always the "
            "same, it is equivalent as well.",
            "- *survived*: no case finds it, and it is not equivalent in that sense.",
            "- *undecided*: time ran out, or something broke.",
            "- *invalid*: the changed module cannot be imported. Does not count.",
            "",
            "## Which cases find what",
            "",
            "Mutants of a class that are killed by at least one case of a group of rules. "
            + ("" if found.cases == 0 else f"A run ends when {many} failed, so more cases would."),
            "",
            *_matrix(found),
            "",
            "## Survivors",
            "",
            *(_survivors(found) or ["None."]),
            "",
            "## Mutants",
            "",
            *markdown_table(
                ["mutant", "line", "rule", "change", "killed by"],
                [
                    [f"`{row.id}`", row.line, row.rule, f"`{_change(row)}`", _killers(row)]
                    for row in found.rows
                ],
                ("rule", "change", "killed by"),
            ),
            "",
        ]
    )


def _change(row: Row) -> str:
    text = f"{row.old}  =>  {row.new}"
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"


def _killers(row: Row) -> str:
    if row.verdict != "killed":
        return f"*{row.verdict}*"
    return ", ".join(case.removeprefix("AMCM/") for case in row.cases) or "ends at once"


def _survivors(found: Certificate) -> list[str]:
    open_ = [row for row in found.rows if row.verdict in ("survived", "undecided")]
    return [line for row in open_ for line in ("```", *survivor(row), "```", "")]


def _matrix(found: Certificate) -> list[str]:
    groups = sorted({case.split("/")[2] for row in found.rows for case in row.cases})
    rows: list[list[object]] = []
    for name, of in _by_class(found):
        hit = Counter(group for row in of for group in {case.split("/")[2] for case in row.cases})
        rows.append([name, len(of), *(hit[group] or "" for group in groups)])
    return markdown_table(["class", "mutants", *groups], rows)
