"""The page of the faults of a station, from the results of ``make test-faults``."""

from __future__ import annotations

from typing import Any

from automcm_maintenance.documents.repository import PAGES, ROOT, markdown_table
from automcm_spec.support import markdown as pages

RESULTS = ROOT / "conformance" / "faults.json"


def markdown(found: dict[str, Any]) -> str:
    """The page."""
    faults = found["faults"].items()
    wide = [[name, *f["outcomes"]] for name, f in faults if set(f["outcomes"]) != {"Fin"}]
    narrow = [[name, f["codes"], f["log"], f["effect"]] for name, f in faults]
    heads, ends = ["fault", *found["phases"]], ["fault", "exit code", "log", "effect"]
    return pages.page(
        PAGES / "faults.md.j2",
        found=found,
        outcomes=markdown_table(heads, _alike(wide), heads),
        effects=markdown_table(ends, _alike(narrow), ends),
    )


def _alike(rows: list[list[str]]) -> list[list[str]]:
    """Rows that differ only in their fault as one row."""
    faults: dict[tuple[str, ...], list[str]] = {}
    for fault, *rest in rows:
        faults.setdefault(tuple(rest), []).append(fault)
    return [["; ".join(names), *rest] for rest, names in faults.items()]
