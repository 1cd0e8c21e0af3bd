"""The pages of the site that are built from the code and from committed results, not committed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from automcm_maintenance.documents.repository import ROOT

RESULTS = ROOT / "docs" / "evaluation"


def pages() -> dict[str, Callable[[], str]]:
    """Each page by its name below docs/."""
    from automcm_evaluation.sweeps import report
    from automcm_evaluation.sweeps.catalogue import NAMES
    from automcm_maintenance.corpus import corpus_page
    from automcm_maintenance.documents import citations, cli_page, models_page
    from automcm_spec.model_checking import models

    details = {
        f"evaluation/{name}/{report.PAGE}": partial(_details, RESULTS / name / report.RESULTS)
        for name in NAMES
    }
    return {
        "cli.md": cli_page.text,
        "corpus.md": partial(corpus_page.page, ROOT / "traces" / "corpus"),
        "models.md": lambda: models_page.models_page(models.load()),
        "rule-coverage.md": lambda: citations.table(ROOT),
        **details,
    }


def _details(results: Path) -> str:
    from automcm_evaluation.sweeps import report

    return report.page(report.load(results))
