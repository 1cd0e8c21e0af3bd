"""The definition of an experiment: settings, independent cells, summary and claims."""

from __future__ import annotations

import json
import sys
import tomllib
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from automcm_evaluation.framework import claims
from automcm_evaluation.framework.claims import Claim
from automcm_evaluation.framework.intervals import wilson
from automcm_simulation.road.figures import NamedFigures

Json = Any
Values = dict[str, Json]
"""The parameters or the results of a cell: JSON, equal on every machine."""
PAGES = Path(__file__).parents[1] / "pages"
"""NAME.md.j2 and NAME.claims.toml of each experiment: its page and its claims."""


class ExperimentError(ValueError):
    """An impossible setting, or unusable results; the text names them."""


class ExperimentSettings(BaseModel):
    """The settings of an experiment.  Each field has a range, and a value in each profile."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def captions(name: str, table: str) -> dict[str, str]:
    """Captions of an experiment: pages/captions.toml."""
    found: dict[str, str] = data("captions")[name][table]
    return found


@cache
def data(file: str) -> Values:
    """What is in pages/FILE.toml."""
    return tomllib.loads((PAGES / f"{file}.toml").read_text(encoding="utf-8"))


@dataclass(frozen=True, slots=True)
class Cell:
    """A part of a sweep, run with these values and its own seed."""

    values: Values
    result: Values


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """One experiment.

    ``run`` gets a cell's values and its seed; equal ones give equal results, in any process and
    order.  ``summary`` computes from all cells the data of tables, figures and claims.  ``names``
    and ``figures`` get the complete report (``report.assemble``) and use no other data.
    """

    name: str
    title: str
    settings: type[ExperimentSettings]
    cells: Callable[[Any], list[Values]]
    run: Callable[[Values, int], Values]
    summary: Callable[[Sequence[Cell]], Values]
    names: Callable[[Values], Values]
    """What the page and the claims use, besides ``names_of``.  The constants of its module are
    names, too, in lower case; figures are named FIGURE.svg."""
    figures: Callable[[Values], NamedFigures]
    """Only called if matplotlib is installed."""

    @property
    def profiles(self) -> dict[str, ExperimentSettings]:
        """The settings of each profile, from pages/profiles.toml."""
        given = data("profiles")[self.name]
        return {profile: self.settings.model_validate(of) for profile, of in given.items()}

    def set(self, profile: str, changes: Mapping[str, Json]) -> ExperimentSettings:
        """The settings of a profile, with some of them changed.

        Raises ExperimentError, which names the setting, its value and its range.
        """
        if profile not in self.profiles:
            raise ExperimentError(
                f"there is no profile {profile!r}; there are: {', '.join(self.profiles)}"
            )
        settings = self.profiles[profile].model_dump(mode="json")
        if unknown := ", ".join(name for name in changes if name not in settings):
            known = ", ".join(settings)
            raise ExperimentError(f"{unknown}: there is no such setting; there are: {known}")
        try:
            return self.settings.model_validate(settings | dict(changes))
        except ValidationError as error:
            found = [(".".join(map(str, e["loc"])), e["input"], e["msg"]) for e in error.errors()]
            texts = (f"{where}: {value!r}: {problem}" for where, value, problem in found)
            raise ExperimentError("; ".join(texts)) from None

    def names_of(self, report: Values) -> Values:
        """The names that the page and the claims may use; ``s`` is the summary."""
        module = vars(sys.modules[self.names.__module__])
        usual = {name.lower(): value for name, value in module.items() if name.isupper()}
        usual |= {"s": report["summary"], "settings": report["settings"], "wilson": wilson}
        usual["seconds"] = lambda ms: f"{ms / 1000:g} s"
        return usual | {"all": all, "any": any, "zip": zip} | self.names(report)

    def claims(self, report: Values) -> list[Claim]:
        """The claims of pages/NAME.claims.toml."""
        return claims.read(PAGES / f"{self.name}.claims.toml", self.names_of(report))


def grid(**values: Json) -> list[Values]:
    """A cell for each combination of the values; a value that is not iterable stands for itself."""
    lists = [
        v if isinstance(v, Iterable) and not isinstance(v, str | dict) else (v,)
        for v in values.values()
    ]
    return [dict(zip(values, each, strict=True)) for each in product(*lists)]


def blocks(trials: int, size: int) -> list[Values]:
    """So many trials in blocks of this size."""
    return [{"block": n // size, "trials": min(size, trials - n)} for n in range(0, trials, size)]


def cells_of(report: Values) -> list[Cell]:
    """The cells of a report."""
    return [Cell(cell["values"], cell["result"]) for cell in report["cells"]]


def chosen(cells: Sequence[Cell], **values: Json) -> list[Cell]:
    """The cells with these values."""
    return [cell for cell in cells if all(cell.values.get(name) == v for name, v in values.items())]


def groups(cells: Sequence[Cell], *names: str) -> list[tuple[Values, list[Cell]]]:
    """The cells by their values of these names, which each group has as a row, in their order."""
    found: dict[tuple[Any, ...], list[Cell]] = defaultdict(list)
    for cell in cells:
        found[tuple(cell.values[name] for name in names)].append(cell)
    return [(dict(zip(names, key, strict=True)), some) for key, some in sorted(found.items())]


def agreed_share(cells: Sequence[Cell], digits: int = 6) -> Values:
    """The ``trials`` in these cells, how many ``agreed``, their ``share`` and its 95 % interval,
    ``low`` to ``high``."""
    trials = sum(cell.values["trials"] for cell in cells)
    agreed = sum(cell.result["agreed"] for cell in cells)
    low, high = (round(limit, digits) for limit in wilson(agreed, trials))
    at = round(agreed / trials, digits)
    return {"trials": trials, "agreed": agreed, "share": at, "low": low, "high": high}


def columns(rows: Sequence[Values]) -> Values:
    """The values of all rows by name; all rows must have the names of the first."""
    return {name: [row[name] for row in rows] for name in rows[0]}


def canonical(value: Any) -> str:
    """JSON on one line; equal values give equal text."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
