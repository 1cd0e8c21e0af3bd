"""Runs of the reference, also with faults; what really happened; and their logs, rewritten."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from automcm.links.simulated_radio import Channel, Radio
from automcm_maintenance.corpus.corpus_bad import renumber
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.log_format.log import Receive
from automcm_spec.log_format.reader import Log, read
from automcm_spec.vocabulary.messages import BROADCAST, decode
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.system.event_order import Node
from automcm_traces.system.log_merge import Merged

Drop = Callable[[int, int, Any, int], bool]
"""Whether a copy from a station to a station, of a message, at a time, is lost."""


def matches_of(merged: Merged) -> dict[Node, tuple[Node, Node]]:
    """The transmission of each reception, and the first that it can have been."""
    return {
        (i, k): match[:2]
        for i, log in enumerate(merged.logs)
        for n, k in enumerate(
            k for k, (_, e) in enumerate(log.events) if isinstance(e, Receive) and e.message
        )
        if (match := merged.matches.match(i, n))
    }


@dataclass
class Run:
    """Prescriber 1, target 2 and bystander 3 on a radio that is perfect but for ``drop``."""

    folder: Path
    channel: Channel = field(default_factory=lambda: Channel(delay_ms=(2, 40)))
    drop: Drop = lambda src, dst, message, now: False
    seed: int = 1
    maneuver_ms: int = 3000
    lease_ms: int = 20_000
    simulation: Simulation = field(init=False)
    phases: dict[int, list[tuple[int, str]]] = field(default_factory=dict)
    """What each station entered when: recorded beside the logs."""
    lost: int = 0

    def __post_init__(self) -> None:
        self.folder.mkdir(exist_ok=True)
        self.simulation = Simulation(seed=self.seed, channel=self.channel, logs=self.folder)
        radio, send = self.simulation.radio, Radio._send

        def filtered(src: int, data: bytes, to: int, tx: str) -> None:
            message = decode(data)
            for dst in radio._receivers:
                if dst == src or to not in (BROADCAST, dst):
                    continue
                if self.drop(src, dst, message, self.simulation.clock.now()):
                    self.lost += 1
                else:
                    send(radio, src, data, dst, tx)

        radio._send = filtered  # type: ignore[method-assign]
        for station in (1, 2, 3):
            self._add(station)
        self.simulation.request(1, at=500)

    def _add(self, station: int) -> None:
        entered = self.phases[station] = [(0, "STANDALONE")]

        def observe(before: Any, effects: Any) -> None:
            if effects.state.phase != entered[-1][1]:
                entered.append((effects.now_ms, effects.state.phase))

        driver = Straight(target=2, maneuver_ms=self.maneuver_ms, lease_ms=self.lease_ms)
        self.simulation.add(station, driver, Parameters(), observers=(observe,))

    def logs(self, until: int = 8_000) -> list[Log]:
        self.simulation.run(until=until)
        return [read(self.folder / f"{station}.ndjson") for station in (1, 2, 3)]

    def left(self, station: int) -> int:
        """When a station left ACTUATING."""
        entered = self.phases[station]
        at = [phase for _, phase in entered].index("ACTUATING")
        return entered[at + 1][0]

    def hazard(self) -> int:
        """How many ms the prescriber acted after its target had left."""
        return self.left(1) - self.left(2)


@cache
def _plain() -> dict[str, bytes]:
    with TemporaryDirectory() as folder:
        Run(Path(folder)).logs()
        return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def plain(folder: Path) -> list[Log]:
    """The logs of a run without faults, to be changed; it is made once."""
    for name, data in _plain().items():
        (folder / name).write_bytes(data)
    return [read(folder / name) for name in sorted(_plain())]


def simulated(
    folder: Path,
    *stations: int,
    until: int,
    seed: int = 3,
    loss: float = 0,
    duplicate: float = 0,
    asks: Sequence[int] = (500,),
    restarts: Mapping[int, int] | None = None,
    parameters: Parameters | None = None,
    **driver: Any,
) -> list[Path]:
    """The logs of stations that drive straight on. The first asks for a maneuver at ``asks``, and
    stations restart at ``restarts``; all times in ms."""
    channel = Channel(loss=loss, duplicate=duplicate)
    simulation = Simulation(seed=seed, channel=channel, logs=folder)
    for station in stations:
        simulation.add(station, Straight(**driver), parameters)
    for at in asks:
        simulation.request(stations[0], at=at)
    for station, at in (restarts or {}).items():
        simulation.restart(station, at=at)
    simulation.run(until=until)
    return sorted(folder.glob("*.ndjson"))


def records(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def rewritten(path: Path, lines: list[dict[str, Any]]) -> Log:
    """A log with other records, its events numbered anew."""
    renumber(lines)
    path.write_text("".join(json.dumps(record) + "\n" for record in lines))
    return read(path)


def killed(path: Path, at: int) -> Log:
    """A log that stops at a time, without an end."""
    lines = [r for r in records(path) if r["rec"] == "header" or r.get("t_ms", at) < at]
    return rewritten(path, [r for r in lines if r["rec"] != "end"])


def without_tx(path: Path) -> Log:
    """A log whose link does not name transmissions."""
    lines = records(path)
    for record in lines:
        if record.get("ev") == "receive":
            del record["tx"]
    return rewritten(path, lines)


def later(path: Path, ms: int, folder: Path | None = None) -> Path:
    """A log on a clock that is ahead, in its place or in another folder."""
    lines = records(path)
    for record in lines:
        record |= {name: record[name] + ms for name in ("t_ms", "deadline") if name in record}
    moved = (folder or path.parent) / path.name
    moved.write_text("".join(json.dumps(record) + "\n" for record in lines))
    return moved
