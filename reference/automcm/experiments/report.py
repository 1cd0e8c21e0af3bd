"""What a sweep leaves behind: results.json, a CSV, figures, and pages of Markdown.

``results.json`` holds the cells and what was made of them; everything else is made from it alone.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from automcm.experiments import NAMES, experiment, figures
from automcm.experiments.experiment import Cell, Experiment, ExperimentError, Values
from automcm_spec import files

RESULTS = "results.json"


def assemble(made: Experiment, about: Values, cells: Sequence[Cell]) -> Values:
    """The report: ``about``, the cells, their summary and the claims."""
    report = dict(about) | {
        "cells": [asdict(cell) for cell in cells],
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
    code: Any
    cells: list[Cell]


def load(path: Path) -> Values:
    """A report, its summary and claims made anew.

    Raises ExperimentError for a file that is none; OSError.
    """
    try:
        found = _Report.model_validate_json(path.read_bytes())
        made = experiment(found.experiment)
    except (ValidationError, ExperimentError) as error:
        raise ExperimentError(f"{path}: is no report of an experiment: {error!r}") from None
    return assemble(made, found.model_dump(exclude={"cells"}), found.cells)


def write(report: Values, folder: Path) -> list[Path]:
    """All files of a report; no figures without matplotlib.  Returns those written."""
    made = experiment(report["experiment"])
    texts = {
        RESULTS: json.dumps(report, indent=1, sort_keys=True, allow_nan=False) + "\n",
        f"{made.name}.csv": table(report),
        f"{made.name}.md": "\n".join(page(report)) + "\n",
    }
    written = []
    for name, text in texts.items():
        path = folder / name
        files.write(path, text)
        written.append(path)
    if figures.available():
        for name, figure in made.figures(report):
            written += figures.save(figure, folder / name)
    return written


def table(report: Values) -> str:
    """CSV: a row for each cell with what it was run with and each plain value that came out."""
    rows = []
    for cell in report["cells"]:
        values = _plain("", cell["values"]) | _plain("", cell["result"])
        rows.append(values)
    names = list(dict.fromkeys(name for row in rows for name in row))
    out = io.StringIO()
    writer = csv.DictWriter(out, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def _plain(prefix: str, values: Values) -> Values:
    found: Values = {}
    for name, value in sorted(values.items()):  # as in results.json
        if isinstance(value, dict):
            found |= _plain(f"{prefix}{name}.", value)
        elif not isinstance(value, list):
            found[f"{prefix}{name}"] = value
    return found


def page(report: Values, images: str = "") -> list[str]:
    """The report as Markdown; figures are looked for in the folder ``images``."""
    made = experiment(report["experiment"])
    lines = [f"# {made.title}", "", *_claims(report["claims"]), ""]
    for line in made.page(report).splitlines():
        lines.append(line.replace("](", f"]({images}") if line.startswith("![") else line)
    command = f"automcm experiment {made.name} --profile {report['profile']}"
    changed = _changed(made, report)
    lines += [
        "",
        f"Made by `{command} --seed {report['seed']}{changed}` with version "
        f"{report['version']}, code {report['code']}.",
    ]
    return lines


def _changed(made: Experiment, report: Values) -> str:
    """The settings that are not the profile's, as options."""
    usual = made.profiles[report["profile"]].model_dump(mode="json")
    changed = {k: report["settings"][k] for k in usual if report["settings"][k] != usual[k]}
    return "".join(f" --set {name}={json.dumps(value)}" for name, value in changed.items())


def _claims(claims: Sequence[Values]) -> list[str]:
    lines = ["| claim | the paper | here | verdict | why |", "|---|---|---|---|---|"]
    for claim in claims:
        cells = (claim[name].replace("|", "\\|") for name in ("claim", "paper", "here"))
        lines.append(f"| {' | '.join(cells)} | **{claim['verdict']}** | {claim['why']} |")
    return lines


def evaluation(folder: Path) -> str:
    """docs/evaluation.md: all claims, then each experiment, from the results below a folder.

    Raises ExperimentError, OSError.
    """
    reports = [load(folder / name / RESULTS) for name in NAMES]
    lines = [
        "# The paper's evaluation",
        "",
        "Generated from the results in `docs/evaluation/` (`make generate`): no figure on this",
        "page was typed. Each experiment can be run again with the command below it; equal seeds",
        "give equal bytes. `automcm experiment all --profile standard` runs all of them.",
        "",
        "*Reproduced*: the figure comes out within what the paper leaves open. *In shape only*:",
        "the effect is there, in its direction and place, with other figures. *Not reproduced*:",
        "it does not come out. *Beyond the paper*: the paper has no such figure.",
        "",
        "## All claims",
        "",
        *_claims([claim for report in reports for claim in report["claims"]]),
    ]
    for report in reports:
        own = page(report, f"{folder.name}/{report['experiment']}/")
        lines += ["", *(f"#{line}" if line.startswith("#") else line for line in own)]
    return "\n".join(lines) + "\n"
