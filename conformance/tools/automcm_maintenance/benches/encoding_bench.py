"""The saving by the radio's encoding: its states compared with two naive encodings."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from automcm_cli.shared.common import table_of
from automcm_spec.model_checking import tlc
from automcm_spec.support import scratch
from automcm_spec.support.paths import BENCH, TLA

#: The naive encodings must have at least this many times the states.
FACTOR = 20

ENCODINGS = {
    "set": ("System", "a set that never shrinks, reduced"),
    "consumed_set": ("Naive", "a set; receiving takes out, anything may be lost"),
    "bag": ("Naive", "a bag of at most two copies; receiving takes out, anything may be lost"),
}
"""Each cfg of spec/bench, the specification's encoding first: its module and description."""

_SECONDS = re.compile(r"^(\s*Seconds = )\d+$", re.MULTILINE)


class BenchError(Exception):
    """A run that gives no comparison."""


@dataclass(frozen=True)
class Figure:
    """TLC's result with an encoding.  If TLC did not finish, the counts are lower bounds.

    seconds is the duration, including the start of Java.
    """

    encoding: str
    about: str
    distinct_states: int
    states: int
    depth: int
    seconds: float
    finished: bool


@dataclass(frozen=True)
class EncodingFigures:
    """The specification's encoding and the naive ones on the same model, measured in sequence."""

    ours: Figure
    naive: tuple[Figure, ...]

    def ratio(self, figure: Figure) -> float:
        """The ratio of an encoding's distinct states; a lower bound if TLC did not finish."""
        return figure.distinct_states / self.ours.distinct_states

    @property
    def shown(self) -> bool | None:
        """Whether every naive encoding has FACTOR times the states; None if undecided."""
        less = [figure for figure in self.naive if self.ratio(figure) < FACTOR]
        if any(figure.finished for figure in less):
            return False
        return None if less else True

    @property
    def exit_code(self) -> int:
        """0 if FACTOR is reached, 1 if not, 4 if the time was too short to decide."""
        return {True: 0, False: 1, None: 4}[self.shown]

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON."""
        return {
            "factor": FACTOR,
            "reached": self.shown,
            "encodings": [
                {
                    "name": figure.encoding,
                    "about": figure.about,
                    "distinct_states": figure.distinct_states,
                    "states": figure.states,
                    "depth": figure.depth,
                    "seconds": round(figure.seconds, 1),
                    "finished": figure.finished,
                    "ratio": round(self.ratio(figure), 1),
                    "ratio_is_lower_bound": not figure.finished,
                }
                for figure in (self.ours, *self.naive)
            ],
        }


def run(
    seconds: int, notify: Callable[[str], None] = lambda text: None, *, bench: Path = BENCH
) -> EncodingFigures:
    """Measure every encoding, each naive one for at most ``seconds``.

    bench is the folder of the cfgs.  Raises tlc.TlcError if TLC gives no verdict, and BenchError if
    it finds a violation or does not finish with the specification's encoding.
    """
    figures: list[Figure] = []
    for name in ENCODINGS:
        notify(f"{name}: " + ("until it ends" if not figures else f"at most {seconds} s"))
        figures.append(_measure(name, seconds, bench))
    ours, *naive = figures
    if not ours.finished:
        raise BenchError("TLC did not finish with the specification's own encoding")
    return EncodingFigures(ours, tuple(naive))


def _measure(name: str, seconds: int, bench: Path) -> Figure:
    module, about = ENCODINGS[name]
    progress: list[tlc.Progress] = []
    with scratch.folder("bench") as folder:
        cfg = folder / f"{name}.cfg"
        text = (bench / f"{name}.cfg").read_text(encoding="utf-8")
        cfg.write_text(_SECONDS.sub(rf"\g<1>{seconds}", text), encoding="utf-8")
        r = tlc.run(module, cfg, tla_dir=TLA, on_progress=progress.append)
    if r.outcome != "holds":
        raise BenchError(f"{name}: {r.property or 'a property'} is violated")
    # TLC also prints "No error has been found" when the time limit stops it, but states are left.
    finished = bool(progress) and progress[-1].queue == 0
    return Figure(name, about, r.distinct_states, r.states, r.depth, r.seconds, finished)


def show(report: EncodingFigures, console: Console) -> None:
    """Print the table and the conclusion."""
    table = table_of("encoding", "distinct states", "depth", "seconds", "ratio")
    table.add_column("")
    for figure in (report.ours, *report.naive):
        table.add_row(*_row(report, figure))
    console.print(
        "1 prescriber, 1 receiver, 2 sessions, 2 proposals; S-1 to S-5 hold as far as seen"
    )
    console.print(table)
    for figure in (report.ours, *report.naive):
        console.print(f"{figure.encoding}: {figure.about}", highlight=False)
    console.print(_conclusion(report), highlight=False)


def _row(report: EncodingFigures, figure: Figure) -> list[str]:
    bound = "" if figure.finished else ">= "
    return [
        figure.encoding,
        f"{bound}{figure.distinct_states:,}",
        str(figure.depth),
        f"{figure.seconds:.1f}",
        f"{bound}{report.ratio(figure):.1f}",
        "finished" if figure.finished else "not finished",
    ]


def _conclusion(report: EncodingFigures) -> str:
    if report.shown:
        return f"Every naive encoding has at least {FACTOR} times the states."
    if report.shown is None:
        return f"Too short to tell whether it is {FACTOR} times the states: give more --seconds."
    return f"A naive encoding has less than {FACTOR} times the states."
