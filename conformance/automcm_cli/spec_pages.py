"""``automcm spec pages``: the committed counterexamples as pages, and a list of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from automcm_cli import trace_html
from automcm_cli.generated import COUNTEREXAMPLES
from automcm_spec import files, models
from automcm_traces.page import html


def write(
    loaded: Iterable[models.Model], folder: Path, say: Callable[[str], None] = lambda text: None
) -> list[Path]:
    """A page for each must-fail model that can have one, in ``folder``; docs/models.md links to
    them.

    Raises what ``trace_html.page_of`` raises, and OSError.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for model in loaded:
        if model.expect == "violates" and not model.unsent:
            say(model.cfg)
            source = COUNTEREXAMPLES / f"{model.cfg}.itf.json"
            path = folder / f"{model.cfg}.html"
            files.write(path, html(trace_html.page_of([source], None)))
            written.append(path)
    return written
