"""HTML pages of counterexamples: the committed ones (``automcm spec pages``), and those of models
with unexpected results in ``automcm verify``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from automcm_cli.spec import model_output
from automcm_cli.trace import trace_html
from automcm_maintenance.documents.generated_files import COUNTEREXAMPLES
from automcm_spec.model_checking import models
from automcm_spec.model_checking.tlc import TlcError
from automcm_spec.support import files
from automcm_spec.support.bad_input import BadInput
from automcm_traces.export.behaviour_to_log import BehaviourError
from automcm_traces.export.itf import ItfError
from automcm_traces.viewer.page import html
from automcm_traces.viewer.page_part import PageError

FOLDER = Path("runs/verify")


def committed(
    loaded: Iterable[models.Model], folder: Path, notify: Callable[[str], None] = lambda text: None
) -> list[Path]:
    """Write a page for each must-fail model that can have one; docs/models.md links to them.

    Raises OSError and the errors of ``trace_html.page_of``.
    """
    files.folder(folder, named=True)
    written = []
    for model in loaded:
        if model.expect == "violates" and model.module not in models.ALONE:
            notify(model.cfg)
            written.append(_page(folder, model.cfg, COUNTEREXAMPLES / f"{model.cfg}.itf.json"))
    return written


def _page(folder: Path, name: str, trace: Path) -> Path:
    path = folder / f"{name}.html"
    files.write(path, html(trace_html.page_of([trace], None)))
    return path


def failed(verdicts: Sequence[models.ModelVerdict], folder: Path = FOLDER) -> list[Path]:
    """Write a page for each unexpected counterexample and return the paths.

    A counterexample that cannot be converted to logs is written as ITF.  Raises OSError.
    """
    written = []
    for verdict in verdicts:
        if verdict.ok or not verdict.trace:
            continue
        trace = model_output.write_trace(verdict, folder)
        try:
            written.append(_page(folder, verdict.model.cfg, trace))
        except (ItfError, BadInput, PageError, BehaviourError, TlcError):
            written.append(trace)
    return written
