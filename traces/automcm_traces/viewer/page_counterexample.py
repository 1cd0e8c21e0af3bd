"""What a counterexample of a must-fail model shows: the mechanism taken away, what breaks."""

from __future__ import annotations

import re
from typing import Any

from automcm_spec.model_checking import models
from automcm_spec.support.paths import TLA

Json = Any
_DEFINED = r"^{name}(?:\([^)]*\))? ==.*(?:\n(?!=|-{{4}}|\(\*|\\\*|$).*)*"
"""A definition, up to an empty line, a comment or the end of the module."""


def shown(cfg: str, states: int) -> Json:
    """For ``viewer/panel.js``: the model, its purpose, its replaced operators with their text, and
    the property that its last state violates."""
    model = next(each for each in models.load() if each.cfg == cfg)
    swaps = [pair for change in model.changes if len(pair := change.split(" <- ")) == 2]
    return {
        "model": model.cfg,
        "why": model.why,
        "property": model.property or "",
        "name": model.breaks or "",
        "states": states,
        "changes": [change for change in model.changes if " <- " not in change],
        "replaced": [_replaced(operator, by) for operator, by in swaps],
    }


def _replaced(operator: str, by: str) -> Json:
    """Where the operator that replaces another is defined, and its text."""
    found = {"operator": operator, "by": by, "module": "", "line": 0, "text": ""}
    for path in sorted(TLA.glob("*.tla")):
        module = path.read_text(encoding="utf-8")
        if defined := re.search(_DEFINED.format(name=by), module, re.M):
            line = module.count("\n", 0, defined.start()) + 1
            return found | {"module": path.stem, "line": line, "text": defined[0]}
    return found
