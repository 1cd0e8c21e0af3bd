"""The definition of an experiment: settings, independent cells, summary and claims."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Json = Any
Values = dict[str, Json]
"""The parameters or the results of a cell: JSON, equal on every machine."""
Verdict = Literal["reproduced", "in shape only", "not reproduced", "beyond the paper"]
PROFILES = ("quick", "standard")
PAGES = Path(__file__).parents[1] / "pages"
"""Templates of the experiments' pages."""


class ExperimentError(ValueError):
    """An impossible setting, or unusable results; the text names them."""


class Settings(BaseModel):
    """The settings of an experiment.  Each field has a range, and a value in each profile."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


@dataclass(frozen=True, slots=True)
class Cell:
    """A part of a sweep, run with these values and its own seed."""

    values: Values
    result: Values


@dataclass(frozen=True, slots=True)
class Claim:
    """A statement of the paper, or a further one, and the result here.

    ``paper`` and ``here`` are the two figures with their units; ``why`` explains a difference.
    """

    claim: str
    paper: str
    here: str
    verdict: Verdict
    why: str = ""


def graded(all_: bool, some: bool) -> Verdict:
    """Reproduced if all parts hold; in shape if some do."""
    return "reproduced" if all_ else "in shape only" if some else "not reproduced"


def beyond(claim: str, here: str, holds: bool = True, why: str = "") -> Claim:
    """A claim without a figure in the paper."""
    return Claim(claim, "-", here, "beyond the paper" if holds else "not reproduced", why)


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """One experiment.

    ``run`` gets a cell's values and its seed; equal ones give equal results, in any process and
    order.  ``summary`` computes from all cells the data of tables, figures and claims.  The other
    functions get the complete report (``report.assemble``) and use no other data.
    """

    name: str
    title: str
    settings: type[Settings]
    profiles: Mapping[str, Settings]
    cells: Callable[[Any], list[Values]]
    run: Callable[[Values, int], Values]
    summary: Callable[[Sequence[Cell]], Values]
    claims: Callable[[Values], list[Claim]]
    page: Callable[[Values], str]
    """The report as Markdown, without its title and claims; figures are named FIGURE.svg."""
    figures: Callable[[Values], Iterator[tuple[str, Figure]]]
    """Name and drawing of each figure; only called if matplotlib is installed."""

    def set(self, profile: str, changes: Mapping[str, Json]) -> Settings:
        """The settings of a profile, with some of them changed.

        Raises ExperimentError, which names the setting, its value and its range.
        """
        if profile not in self.profiles:
            raise ExperimentError(
                f"there is no profile {profile!r}; there are: {', '.join(self.profiles)}"
            )
        try:
            return self.settings.model_validate(
                self.profiles[profile].model_dump(mode="json") | dict(changes)
            )
        except ValidationError as error:
            texts = []
            for e in error.errors():
                where = ".".join(str(part) for part in e["loc"])
                if e["type"] == "extra_forbidden":
                    known = ", ".join(self.settings.model_fields)
                    texts.append(f"{where}: there is no such setting; there are: {known}")
                else:
                    texts.append(f"{where}: {e['input']!r}: {e['msg']}")
            raise ExperimentError("; ".join(texts)) from None


def chosen(cells: Sequence[Cell], **values: Json) -> list[Cell]:
    """The cells with these values."""
    return [cell for cell in cells if all(cell.values.get(name) == v for name, v in values.items())]


def columns(rows: Sequence[Values]) -> Values:
    """The values of all rows by name; all rows must have the names of the first."""
    return {name: [row[name] for row in rows] for name in rows[0]}


def canonical(value: Any) -> str:
    """JSON on one line; equal values give equal text."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
