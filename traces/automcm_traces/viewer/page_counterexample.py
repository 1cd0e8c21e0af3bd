"""What a counterexample of a must-fail model shows: the mechanism taken away, what breaks."""

from __future__ import annotations

import re
from typing import Any

from automcm_spec.model_checking import models
from automcm_spec.support.paths import TLA

Json = Any
_DEFINED = re.compile(r"^(\w+)(?:\([^)]*\))? ==")
_END = re.compile(r"^(?:=|-{4}|\(\*|\\\*|$)")


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
    for path in sorted(TLA.glob("*.tla")):
        lines = path.read_text(encoding="utf-8").splitlines()
        for n, line in enumerate(lines):
            if (found := _DEFINED.match(line)) and found[1] == by:
                end = next(
                    (k for k in range(n + 1, len(lines)) if _END.match(lines[k])), len(lines)
                )
                text = "\n".join(lines[n:end])
                return {"operator": operator, "by": by, "module": path.stem, "line": n + 1} | {
                    "text": text
                }
    return {"operator": operator, "by": by, "module": "", "line": 0, "text": ""}
