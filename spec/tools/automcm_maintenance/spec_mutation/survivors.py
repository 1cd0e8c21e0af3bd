"""The list of mutants that may survive, each with its reason."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from automcm_maintenance.spec_mutation.mutant_runs import MutationReport
from automcm_maintenance.spec_mutation.mutants import Mutant
from automcm_spec.support.paths import MODELS

SURVIVORS = "survivors.toml"


@dataclass(frozen=True)
class Survivor:
    """A listed survivor with its reason.  source is its change (Mutant.change)."""

    source: str
    reason: str


def load(models_dir: Path = MODELS) -> dict[str, Survivor]:
    """The listed survivors by id; none without a file.

    Raises ValueError for an invalid file.
    """
    path = models_dir / SURVIVORS
    if not path.is_file():
        return {}
    found: dict[str, Survivor] = {}
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    for entry in table.get("survivor", []):
        if set(entry) != {"id", "source", "reason"} or not all(
            isinstance(value, str) and value.strip() for value in entry.values()
        ):
            raise ValueError(f"{SURVIVORS}: an entry must have id, source and reason: {entry}")
        if entry["id"] in found:
            raise ValueError(f"{SURVIVORS} lists {entry['id']} twice")
        found[entry["id"]] = Survivor(entry["source"], entry["reason"])
    if unknown := set(table) - {"survivor"}:
        raise ValueError(f"{SURVIVORS}: unknown key {', '.join(sorted(unknown))}")
    return found


def compare(
    report: MutationReport,
    listed: dict[str, Survivor],
    generated: Sequence[Mutant],
    modules: Sequence[str],
) -> list[str]:
    """The problems of the list of survivors: missing entries, and entries that do not survive.

    generated are all mutants of the modules; entries of other modules are ignored.
    """
    known = {mutant.id: mutant for mutant in generated}
    problems = [
        f"{o.mutant.id} survived ({o.mutant.change}) and {SURVIVORS} does not say why"
        for o in report.outcomes
        if o.survived and o.mutant.id not in listed
    ]
    for id_, entry in listed.items():
        if id_.split(".")[0] not in modules:
            continue
        if id_ not in known:
            problems.append(f"{SURVIVORS} lists {id_}, but there is no such mutant")
        elif entry.source != known[id_].change:
            problems.append(f"{SURVIVORS}: {id_} is {known[id_].change}")
    problems += [
        f"{SURVIVORS} lists {o.mutant.id}, but it is {'invalid' if o.invalid else 'killed'}"
        for o in report.outcomes
        if o.mutant.id in listed and not o.survived
    ]
    return problems
