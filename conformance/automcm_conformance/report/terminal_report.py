"""The report of a run on the terminal.

Texts of the station go through ``visible``, which escapes characters that are not printable, and
are never interpreted as markup.
"""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from automcm_conformance.exchange.results import (
    EARLY,
    VERDICTS,
    CaseResult,
    Failure,
    Report,
    Verdict,
    causes,
)
from automcm_conformance.report.report import (
    GROUPS,
    about,
    conformance,
    groups,
    matrix,
    seen_in,
    share,
    totals,
    visible,
    why,
)

STYLES = {"PASS": "green", "FAIL": "red", "INCONC": "yellow", "SKIP": "dim", "ERROR": "magenta"}
CASES = 10
"""The summary names at most this many cases, so that it fits on one screen."""
ORDER: tuple[Verdict, ...] = ("FAIL", "PASS", "ERROR", "INCONC", "SKIP")
"""The order in which it names unexpected cases."""
IN_FULL = 3
"""This many causes are printed with their exchange."""
LINES = 16
"""The summary prints at most this many lines of an exchange, the last ones."""
LIMIT = 400
SHORT = 120


def summary(report: Report, console: Console, folder: Path | None = None) -> None:
    """Print the implementation, the verdict, the counts, the coverage and unexpected cases.

    ``folder`` has the files of the report.
    """
    who = report.implementation
    console.print(_text(f"{who.name} {who.version}".strip(), "bold", SHORT))
    holds, sentence = conformance(report)
    style = {True: "bold green", False: "bold red", None: "bold yellow"}[holds]
    console.print(Text(sentence, style))
    for problem in report.problems:
        console.print(Text("Problem: ", "red") + _text(problem))
    for note in report.notes:
        console.print(_text(f"Note: {note}"))
    console.print()
    _causes(report, console)
    console.print(_counts(report))
    console.print()
    table = _grid()
    for name, pair in totals(report):
        table.add_row(_text(name), Text(share(pair)))
    console.print(table)
    _unexpected(report, console)
    if folder is not None:
        console.print(Text(f"Report: {visible(str(folder / 'report.html'))}"), soft_wrap=True)


def _causes(report: Report, console: Console) -> None:
    """Print the causes of the unexpected failures: some in full, the others in one line."""
    found = causes(report.unexpected)
    for n, cause in enumerate(found[:IN_FULL], 1):
        console.print(Text(f"Cause {n} of {len(found)}", "bold"))
        failure(*cause[0], console, LINES)
        console.print(_text(seen_in(cause)))
        console.print()
    for n, ((case, shown), *_) in enumerate(found[IN_FULL:CASES], IN_FULL + 1):
        head = f"{n} of {len(found)}: {case.verdict} {shown.rule}: "
        console.print(_text(f"{head}{shown.what}", limit=SHORT))
    if len(found) > CASES:
        console.print(Text(f"and {len(found) - CASES} more causes"))
    unclear = sum(case.verdict == "INCONC" for case in report.unexpected)
    if unclear:
        remarks = [*report.problems, *report.notes]
        ended = not found or any(remark.startswith(EARLY) for remark in remarks)
        which = "because the run ended" if ended else "because of the wrong answers"
        cases_were = "case was" if unclear == 1 else "cases were"
        console.print(Text(f"{unclear} {cases_were} not reached ({which})"))
    if found or unclear:
        console.print()


def failure(case: CaseResult, failure: Failure, console: Console, most: int | None = None) -> None:
    """Print one failure: the rule, the guard, the exchange (at most its last ``most`` lines), and
    the answers."""
    console.print(Text(case.verdict, STYLES[case.verdict]) + _text(f" {case.id}", "bold"))
    for text in about(failure):
        console.print(_text(text))
    console.print()
    table = Table(box=None, pad_edge=False)
    table.add_column("ms", justify="right", no_wrap=True)
    table.add_column("kit", ratio=1)
    table.add_column("station", ratio=1)
    omitted = max(0, len(failure.exchange) - most) if most else 0
    if omitted:
        rest = f"… {omitted} lines more; report.html and the replay have them …"
        table.add_row(Text(), Text(rest, "dim"), Text())
    for line in failure.exchange[omitted:]:
        said = _text(line.text)
        cells = (said, Text()) if line.who == "kit" else (Text(), said)
        table.add_row(Text(str(line.now), "dim"), *cells)
    console.print(table)
    console.print()
    _list("Expected one of", failure.allowed, "green", console)
    _list("Received", failure.came, "red", console)
    if failure.command:
        console.print(Text("Replay it with:"))
        console.print(_text(failure.command, limit=10 * LIMIT), soft_wrap=True)


def _counts(report: Report) -> Table:
    counts = matrix(report)
    table = _grid()
    for _ in VERDICTS:
        table.add_column(justify="right")
    table.add_row(Text("rules"), *(Text(verdict, STYLES[verdict]) for verdict in VERDICTS))
    for name in groups([report]):
        found = [(verdict, counts[(name, verdict)]) for verdict in VERDICTS]
        cells = (Text(str(n), STYLES[verdict]) if n else Text(".", "dim") for verdict, n in found)
        table.add_row(_text(f"{name} {GROUPS.get(name, '')}", limit=SHORT), *cells)
    table.add_row(Text("all"), *(Text(str(report.counts[verdict])) for verdict in VERDICTS))
    return table


def _unexpected(report: Report, console: Console) -> None:
    cases = report.unexpected
    console.print()
    if not cases:
        console.print(Text("Every verdict is as expected."))
        return
    console.print(Text(f"Unexpected: {len(cases)} of {len(report.cases)} cases"))
    table = _grid()
    table.add_column(no_wrap=True)
    table.add_column()  # rich shortens a column that may wrap before any that may not
    for case in sorted(cases, key=lambda case: ORDER.index(case.verdict))[:CASES]:
        reason = _text(why(case))
        reason.no_wrap, reason.overflow = True, "ellipsis"
        verdict = Text(case.verdict, STYLES[case.verdict])
        table.add_row(verdict, _text(case.id, limit=SHORT), reason)
    console.print(table)
    if len(cases) > CASES:
        console.print(Text(f"and {len(cases) - CASES} more"))


def _list(title: str, texts: list[str], style: str, console: Console) -> None:
    console.print(Text(title))
    table = Table.grid(padding=(0, 1))
    for text in texts or ["nothing"]:
        table.add_row(Text(" -"), _text(text, style))
    console.print(table)
    console.print()


def _grid() -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True)
    return table


def _text(text: str, style: str = "", limit: int = LIMIT) -> Text:
    return Text(visible(text, limit=limit), style)
