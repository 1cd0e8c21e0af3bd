"""The pages of the site that are built from the code and from committed results, not committed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from automcm_maintenance.documents.repository import ROOT

RESULTS = ROOT / "docs" / "evaluation"


def pages() -> dict[str, Callable[[], str]]:
    """Each page by its name below docs/."""
    from automcm_evaluation.sweeps import report
    from automcm_evaluation.sweeps.catalogue import NAMES
    from automcm_maintenance.code_mutation import certificate_page
    from automcm_maintenance.corpus import corpus_page
    from automcm_maintenance.documents import citations, cli_page, faults_page, models_page
    from automcm_maintenance.spec_mutation import mutant_results
    from automcm_spec.model_checking import models

    details = {
        f"evaluation/{name}/{report.PAGE}": partial(_details, RESULTS / name / report.RESULTS)
        for name in NAMES
    }
    commands = {name: partial(str, text) for name, text in cli_page.texts().items()}
    return {
        "certificate.md": lambda: certificate_page.markdown(_json(certificate_page.RESULTS)),
        **commands,
        "corpus.md": partial(corpus_page.page, ROOT / "traces" / "corpus"),
        "faults.md": lambda: faults_page.markdown(_json(faults_page.RESULTS)),
        "index.md": _first_page,
        "models.md": lambda: models_page.models_page(models.load()),
        "mutation.md": lambda: mutant_results.page(mutant_results.load()),
        "rule-coverage.md": lambda: citations.table(ROOT),
        **details,
    }


def _first_page() -> str:
    """The README up to its commands, with links from docs/."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8").split("\n## Model-check it")[0]
    return re.sub(r"\]\((?!https?:|#)(docs/)?", lambda m: "](" if m[1] else "](../", readme)


def _json(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def _details(results: Path) -> str:
    from automcm_evaluation.sweeps import report

    return report.page(report.load(results))
