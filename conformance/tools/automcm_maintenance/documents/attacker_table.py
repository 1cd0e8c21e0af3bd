"""The table of attackers and properties in docs/security.md, from the models with an attacker."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence

from automcm_spec.model_checking import models

ATTACKERS = ("outsider", "insider", "thief")
PROPERTIES = (
    *models.SAFETY,
    *(f"T-{n}" for n in (*range(1, 7), 9)),
    *("L-1", "L-3", "L-4", "R-1", "R-2"),
)
_DEFENCES = ("Dies", "WindowOf", "MaySign", "Signed", "OfPeer", "WithinRounds")
"""Parts of the envelope and of the station. A model that replaces one is not in the table."""


def table(loaded: Sequence[models.Model]) -> str:
    """A row for each property, a column for each attacker; a cell names its models."""
    cells: defaultdict[tuple[str, str], list[str]] = defaultdict(list)
    for model in sorted(loaded, key=lambda m: (m.expect, models.PROFILES.index(m.profile))):
        if model.module in models.ATTACKED:
            for property_ in _shown(model):
                verdict = f"{'holds' if model.expect == 'holds' else 'fails'} (`{model.cfg}`)"
                cells[property_, _attacker(model.config)].append(verdict)
    rows = ["| property | " + " | ".join(ATTACKERS) + " |", "|---|---|---|---|"]
    for property_ in PROPERTIES:
        found = [reversed(cells[property_, attacker]) for attacker in ATTACKERS]
        # The first that holds, and the first that fails.
        firsts = [{text.split()[0]: text for text in cell} for cell in found]
        shown = ["; ".join(sorted(first.values(), reverse=True)) for first in firsts]
        rows.append(f"| {property_} | " + " | ".join(shown) + " |")
    return "\n".join(rows)


def _shown(model: models.Model) -> set[str]:
    """The properties on which the model has a say."""
    text, checks = models.split(model.config)
    if any(re.search(rf"\b{name} <-", text) for name in _DEFENCES):
        return set()
    found = {models.PROPERTY_IDS[name] for _, name in checks if name != "TightInv"}
    if "Reduced = TRUE" in text:
        found.discard("S-6")  # about Acks, which are left out
    if len(_ids(text, "Prescribers")) < 2:
        found -= {"S-8", "T-6"}  # about two prescribers
    if model.property == "R-1":
        found.add("R-2")  # includes R-1
    return found


def _attacker(cfg: str) -> str:
    keys = _ids(cfg, "Keys")
    if not keys:
        return "outsider"
    return "thief" if keys <= _ids(cfg, "Honest") else "insider"


def _ids(cfg: str, constant: str) -> set[str]:
    found = re.search(rf"^  {constant} = \{{(.*)\}}$", cfg, re.MULTILINE)
    return set(re.findall(r"\d+", found[1])) if found else set()
