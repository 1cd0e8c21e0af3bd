"""The files of a sweep: results.json, figures, and pages of Markdown.

``results.json`` holds the cells, their summary and the claims; all other files are made from it.
"""

from __future__ import annotations

import json
import lzma
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from automcm_evaluation.framework.experiment import PAGES, Cell, Experiment, ExperimentError, Values
from automcm_evaluation.sweeps.catalogue import NAMES, experiment
from automcm_simulation.road import figures
from automcm_spec.support import files, templates

RESULTS, PAGE = "results.json", "README.md"
COMPRESSED = ".xz"
LARGE_BYTES = 1_000_000
"""Larger results are written as ``results.json.xz``."""


def assemble(made: Experiment, about: Values, cells: Sequence[Cell]) -> Values:
    """The report: ``about`` without the hash of the code, which is for cells that are not yet
    reported, then the cells, their summary and the claims."""
    report = {name: value for name, value in about.items() if name != "code"} | {
        "cells": [{"values": cell.values, "result": cell.result} for cell in cells],
        "summary": made.summary(cells),
    }
    report["claims"] = [asdict(claim) for claim in made.claims(report)]
    return report


class _Report(BaseModel):
    experiment: str
    profile: str
    seed: int
    settings: Values
    version: Any
    cells: list[Cell]


def results(folder: Path) -> list[Path]:
    """The reports in the subfolders."""
    return sorted([*folder.glob(f"*/{RESULTS}"), *folder.glob(f"*/{RESULTS}{COMPRESSED}")])


def load(path: Path) -> Values:
    """Load a report, or the compressed one in its place, and recompute its summary and claims.

    Raises OSError, and ExperimentError for a file that is not a report.
    """
    if not path.exists() and not path.name.endswith(COMPRESSED):
        path = path.with_name(path.name + COMPRESSED)
    data = path.read_bytes()
    try:
        found = _Report.model_validate_json(
            lzma.decompress(data) if path.suffix == COMPRESSED else data
        )
        made = experiment(found.experiment)
    except (lzma.LZMAError, ValidationError, ExperimentError) as error:
        raise ExperimentError(f"{path}: not a report of an experiment: {error!r}") from None
    return assemble(made, found.model_dump(exclude={"cells"}), found.cells)


def write(report: Values, folder: Path) -> list[Path]:
    """Write all files of a report, without figures if matplotlib is missing; returns the paths."""
    made = experiment(report["experiment"])
    data = _json(report).encode()
    name, other = RESULTS, RESULTS + COMPRESSED
    if len(data) > LARGE_BYTES:
        data, name, other = lzma.compress(data), other, name
    (folder / other).unlink(missing_ok=True)
    files.write(folder / name, data)
    files.write(folder / PAGE, page(report))
    written = [folder / name, folder / PAGE]
    if figures.available():
        for name, figure in made.figures(report):
            written += figures.save(figure, folder / name)
    return written


def _json(report: Values) -> str:
    """The report as JSON, each cell on one line."""
    write = partial(json.dumps, sort_keys=True, allow_nan=False)
    cells = ",\n".join(f"  {write(cell)}" for cell in report["cells"])
    rest: str = write(report | {"cells": []}, indent=1)
    return rest.replace('"cells": []', f'"cells": [\n{cells}\n ]', 1) + "\n"


def page(report: Values) -> str:
    """The report in full as Markdown: claims, then the experiment's own page."""
    made = experiment(report["experiment"])
    return templates.page(
        PAGES / "experiment.md.j2",
        made=made,
        report=report,
        changed=_changed(made, report),
        **made.names_of(report),
    )


def _changed(made: Experiment, report: Values) -> str:
    """The settings that differ from the profile's, as options."""
    usual = made.profiles[report["profile"]].model_dump(mode="json")
    changed = {k: report["settings"][k] for k in usual if report["settings"][k] != usual[k]}
    return "".join(f" --set {name}={json.dumps(value)}" for name, value in changed.items())


def evaluation(folder: Path) -> str:
    """docs/evaluation.md: the claims that have a verdict, and a paragraph for each experiment.

    Raises ExperimentError, OSError.
    """
    reports = {name: load(folder / name / RESULTS) for name in NAMES}
    claims = [claim for report in reports.values() for claim in report["claims"]]
    return templates.page(
        PAGES / "evaluation.md.j2",
        folder=folder.name,
        reports=reports,
        of={name: experiment(name).names_of(report) for name, report in reports.items()},
        judged=[claim for claim in claims if claim["verdict"] != "beyond the paper"],
        count=Counter(claim["verdict"] for claim in claims),
    )
