"""docs/models.md."""

from __future__ import annotations

import re
from collections.abc import Sequence

from automcm_cli.spec.model_output import checks
from automcm_maintenance.documents.repository import PAGES
from automcm_spec.model_checking import models
from automcm_spec.support import markdown


def models_page(loaded: Sequence[models.Model]) -> str:
    """docs/models.md: every model with its recorded result."""
    usual = {
        pair for m in loaded if m.expect == "holds" for pair in models.replaced_in(m.config).items()
    }

    def changed(model: models.Model) -> str:
        operators = [
            name for name, by in models.replaced_in(model.config).items() if (name, by) not in usual
        ]
        return ", ".join(f"`{name}`" for name in (*operators, *_missing(model)))

    return markdown.page(
        PAGES / "models.md.j2", models=loaded, alone=models.ALONE, checks=checks, changed=changed
    )


def _missing(model: models.Model) -> list[str]:
    """The timers that the cfg of a model removes."""
    line = re.search(r"^ *Missing = \{(.*)\}", model.config, re.MULTILINE)
    return [f"timer {name}" for name in re.findall(r"\w+", line[1])] if line else []
