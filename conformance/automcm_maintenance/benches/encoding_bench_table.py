"""``automcm spec bench``: the figures as a table."""

from __future__ import annotations

from rich.console import Console

from automcm_cli.shared.common import table_of
from automcm_maintenance.benches.encoding_bench import FACTOR, Figure, Report


def show(report: Report, console: Console) -> None:
    """Print the table and the conclusion."""
    table = table_of("encoding", "distinct states", "depth", "seconds", "ratio")
    table.add_column("")
    for figure in (report.ours, *report.naive):
        table.add_row(*_row(report, figure))
    console.print(
        "1 prescriber, 1 receiver, 2 sessions, 2 proposals; S-1 to S-5 hold as far as seen"
    )
    console.print(table)
    for figure in (report.ours, *report.naive):
        console.print(f"{figure.encoding}: {figure.about}", highlight=False)
    console.print(_conclusion(report), highlight=False)


def _row(report: Report, figure: Figure) -> list[str]:
    bound = "" if figure.finished else ">= "
    return [
        figure.encoding,
        f"{bound}{figure.distinct_states:,}",
        str(figure.depth),
        f"{figure.seconds:.1f}",
        f"{bound}{report.ratio(figure):.1f}",
        "finished" if figure.finished else "not finished",
    ]


def _conclusion(report: Report) -> str:
    if report.shown:
        return f"Every naive encoding has at least {FACTOR} times the states."
    if report.shown is None:
        return f"Too short to tell whether it is {FACTOR} times the states: give more --seconds."
    return f"A naive encoding has less than {FACTOR} times the states."
