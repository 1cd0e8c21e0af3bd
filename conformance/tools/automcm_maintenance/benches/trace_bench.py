"""``automcm bench traces``: the cost of checking logs, compared with reading them."""

from __future__ import annotations

import json
import random
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from automcm_cli.shared.common import Json, progress, table_of, write_json
from automcm_spec.support import scratch

EVENTS = 50
"""Number of events in each log."""


@dataclass(frozen=True, slots=True)
class LogTimes:
    """Seconds of CPU time for the same logs."""

    logs: int
    events: int
    json_s: float
    """json.loads of every line, the baseline."""
    read_s: float
    """LogStream, which checks the format line by line."""
    explain_s: float
    """Reading and checking against the compiled specification."""

    def rows(self) -> list[tuple[str, float]]:
        """Each measured task and its time in s."""
        return [
            ("json.loads alone", self.json_s),
            ("reading (the format checked)", self.read_s),
            ("explain (reading and engine)", self.explain_s),
            ("the engine alone", self.explain_s - self.read_s),
        ]

    def as_dict(self) -> dict[str, Any]:
        """The report for ``--json``."""
        engine = self.explain_s - self.read_s
        return asdict(self) | {
            "explain_events_per_s": round(self.events / self.explain_s),
            "engine_events_per_s": round(self.events / engine),
            "engine_by_reading": round(engine / self.read_s, 2),
        }


def logs(number: int, folder: Path) -> list[Path]:
    """``number`` complete logs of EVENTS events each, from lane changes with loss."""
    return [path for path, _ in zip(_logs(folder), range(number), strict=False)]


def _logs(folder: Path) -> Iterator[Path]:
    from automcm.links.simulated_radio import Channel
    from automcm_simulation.road.simulation import Simulation
    from automcm_simulation.road.straight_lane import Straight
    from automcm_spec.vocabulary.parameters import Parameters

    seed = 0
    while True:
        seed += 1
        chance = random.Random(seed)
        part = folder / str(seed)
        part.mkdir()
        channel = Channel(loss=chance.choice([0.0, 0.2, 0.4]), duplicate=0.05)
        simulation = Simulation(seed=seed, channel=channel, logs=part)
        for station in (1001, 2002, 3003, 4004):
            parameters = Parameters(t_cam=900, t_timeout=chance.choice([0, 1000, 2000]))
            simulation.add(station, Straight(target=3003, maneuver_ms=1500), parameters)
        simulation.request(1001, at=300)
        simulation.run(until=9_000)
        for path in sorted(part.iterdir()):
            lines = path.read_bytes().splitlines(keepends=True)
            if len(lines) > EVENTS + 1:
                path.write_bytes(b"".join(lines[: EVENTS + 1]))
                yield path


def measure(number: int, notify: Callable[[str], None]) -> LogTimes:
    """Measure.  Raises the errors of the TLC engine if it is requested and cannot be run."""
    from automcm_spec.log_format.reader import LogStream
    from automcm_traces.explain.explain import explain_file

    with scratch.folder("bench") as folder:
        notify(f"making {number} logs")
        paths = logs(number, folder)
        explain_file(paths[0])  # late imports and first answers

        def parse() -> None:
            for path in paths:
                for line in path.read_bytes().splitlines():
                    json.loads(line)

        def stream() -> None:
            for path in paths:
                for _ in LogStream(path):
                    pass

        def judge() -> None:
            for path in paths:
                verdict = explain_file(path)
                assert verdict.verdict == "allowed", verdict

        notify("reading and judging")
        json_s, read_s, explain_s = _best([parse, stream, judge])
        return LogTimes(len(paths), len(paths) * EVENTS, json_s, read_s, explain_s)


def _best(tasks: list[Callable[[], None]], rounds: int = 3) -> list[float]:
    """The least CPU time of several alternating rounds of each task."""
    best = [float("inf")] * len(tasks)
    for _ in range(rounds):
        for n, task in enumerate(tasks):
            start = time.process_time()
            task()
            best[n] = min(best[n], time.process_time() - start)
    return best


def traces(
    number: Annotated[
        int, typer.Option("--logs", help=f"Number of logs, each of {EVENTS} events.", min=1)
    ] = 1000,
    json_: Json = None,
) -> None:
    """Measure the log engine's events per second.

    The engine is compared with parsing the same logs.  There is no verdict: the figures depend on
    the machine, the ratios less so.
    """
    with progress() as notify:
        measured = measure(number, notify)
    if not write_json(json_, measured.as_dict()):
        return
    from rich.console import Console

    console = Console()
    console.print(f"{measured.logs} logs of {EVENTS} events, best of three rounds (CPU time)")
    table = table_of("", "events a second", "times reading")
    for name, seconds in measured.rows():
        ratio = f"{seconds / measured.read_s:.2f}"
        table.add_row(name, f"{measured.events / seconds:,.0f}", ratio)
    console.print(table)
