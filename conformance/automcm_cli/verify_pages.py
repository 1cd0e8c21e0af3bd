"""A page for each model that ``automcm verify`` finds to fail: its counterexample."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from automcm_cli import spec, trace_html
from automcm_spec import files, models
from automcm_spec.bad_input import BadInput
from automcm_spec.tlc import TlcError
from automcm_traces.itf import ItfError
from automcm_traces.page import html
from automcm_traces.page_run import PageError
from automcm_traces.story import StoryError

FOLDER = Path("runs/verify")


def write(verdicts: Sequence[models.Verdict], folder: Path = FOLDER) -> list[Path]:
    """Write what each counterexample that is not as expected shows; returns the pages.

    One that cannot be told as logs is left as ITF.  Raises OSError.
    """
    written = []
    for verdict in verdicts:
        if verdict.ok or not verdict.trace:
            continue
        trace = spec.write_trace(verdict, folder)
        try:
            data = html(trace_html.page_of([trace], None))
        except (ItfError, BadInput, PageError, StoryError, TlcError):
            written.append(trace)
            continue
        path = folder / f"{verdict.model.cfg}.html"
        files.write(path, data)
        written.append(path)
    return written
