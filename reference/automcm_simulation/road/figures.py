"""Figures with matplotlib, if it is installed (automcm[plot]); equal data give equal files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from automcm_spec.support import files

if TYPE_CHECKING:
    from matplotlib.axes import Axes as Axes
    from matplotlib.figure import Figure as Figure

NamedFigures = Iterator[tuple[str, "Figure"]]
"""The name of each figure, and its drawing."""


def available() -> bool:
    """Whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


def plots(rows: int = 1, columns: int = 1, *, height: float = 4.5) -> tuple[Figure, list[Axes]]:
    """A figure 8 inches wide with a number of plots, row by row, each with a grid."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, height), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    for plot in axes:
        plot.grid(alpha=0.3)
    return figure, axes


def legend(figure: Figure, plot: Axes, columns: int) -> None:
    """The legend of one plot, above all."""
    figure.legend(*plot.get_legend_handles_labels(), loc="outside upper center", ncols=columns)


def shares(plot: Axes, x: str, rows: Sequence[dict[str, Any]], **style: Any) -> None:
    """The ``share`` of each row in per cent, with its interval from ``low`` to ``high``."""
    low = [100 * (row["share"] - row["low"]) for row in rows]
    high = [100 * (row["high"] - row["share"]) for row in rows]
    at = [100 * row["share"] for row in rows]
    plot.errorbar([row[x] for row in rows], at, [low, high], fmt=".", **style)


def save(figure: Figure, stem: Path) -> list[Path]:
    """The figure as PNG and SVG; returns the files."""
    import matplotlib

    written = []
    with matplotlib.rc_context({"svg.hashsalt": "automcm", "font.size": 9}):
        for kind in ("png", "svg"):
            path = stem.with_name(f"{stem.name}.{kind}")
            with files.writing(path) as file:
                date = {"Date": None} if kind == "svg" else None
                figure.savefig(file, format=kind, dpi=120, metadata=date)
            written.append(path)
    return written
