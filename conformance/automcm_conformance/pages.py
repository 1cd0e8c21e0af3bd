"""The log of a case that is no PASS, as a page (docs/trace-format.md)."""

from __future__ import annotations

from pathlib import Path

from automcm_conformance.results import Report
from automcm_spec import files
from automcm_spec.bad_input import BadInput
from automcm_traces.page import html
from automcm_traces.page_data import load
from automcm_traces.page_run import PageError

MOST = 20
"""Pages of one run; what is beyond has its log."""


def write(report: Report, folder: Path) -> None:
    """Write a page beside the log of each case that is no PASS, and name it in the report.

    Raises OSError if it cannot be written.
    """
    for case in [c for c in report.cases if c.log and c.verdict not in ("PASS", "SKIP")][:MOST]:
        log = folder / case.log
        several = case.log.startswith("scenarios/")
        logs = sorted(log.parent.glob("*.ndjson")) if several else [log]
        try:
            page = load(logs, f"{case.id}: {case.verdict}")
        except (BadInput, PageError):
            continue  # the log is there all the same
        if not several and page.runs[0].verdicts[0].verdict == "allowed":
            page.title = f"{case.id}, up to where it failed"  # which a log cannot always tell
            what = case.failures[0].what if case.failures else case.reason
            page.note = f"Judged up to the end of the log. {case.verdict}, after that: {what}"
        page.runs[0].renamed = f"{folder}/", ""
        path = log.with_suffix(".html")
        files.write(path, html(page))
        case.page = path.relative_to(folder).as_posix()
