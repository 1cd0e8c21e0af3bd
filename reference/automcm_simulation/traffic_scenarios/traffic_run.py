"""Runs a scenario in SUMO's traffic: ``automcm simulate traffic`` and experiments use it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from automcm.encoding.codec import codec
from automcm_simulation.radio.ns3_radio import Ns3Radio
from automcm_simulation.radio.radio import RadioModel
from automcm_simulation.radio.table_radio import TableRadio
from automcm_simulation.traffic.even_radio import EvenRadio
from automcm_simulation.traffic.mover import TrafficError
from automcm_simulation.traffic.seen_from_above import Frames
from automcm_simulation.traffic.sumo_mover import SumoMover
from automcm_simulation.traffic.traffic import Traffic
from automcm_simulation.traffic.traffic_scenario import TrafficSetting
from automcm_simulation.traffic_scenarios.catalogue import SCENARIOS
from automcm_spec.support import scratch
from automcm_spec.support.extras import MissingExtra

RadioName = Literal["even", "table", "ns3"]


@dataclass(frozen=True, kw_only=True)
class TrafficRun:
    """One run: the name of its scenario, its setting, its radio and its codec."""

    scenario: str
    setting: TrafficSetting = field(default_factory=TrafficSetting)
    radio: RadioName = "even"
    loss: float = 0.0
    """Of the radio ``even``."""
    codec: str = "json"

    # Raises ValueError, also for more vehicles than the road has room for.
    def __post_init__(self) -> None:
        if self.scenario not in SCENARIOS:
            raise ValueError(f"scenario must be one of {', '.join(SCENARIOS)}, not {self.scenario}")
        if not 0 <= self.loss <= 1:
            raise ValueError(f"loss must be from 0 to 1, not {self.loss}")
        if self.loss and self.radio != "even":
            raise ValueError(f"loss is a setting of the radio 'even', not of {self.radio!r}")
        SCENARIOS[self.scenario].users(self.setting)

    def drive(
        self,
        *,
        logs: Path | None = None,
        frames: Frames | None = None,
        gui: bool = False,
        progress: Callable[[int], None] = lambda now_ms: None,
    ) -> Traffic:
        """Run it to its end.  Raises TrafficError, for example without SUMO or ns-3.

        ``logs`` is the folder for the logs; those of an earlier run are deleted when this one can
        begin.  ``frames`` takes the positions of all road users; ``progress`` gets the simulated
        time.
        """
        scenario, setting = SCENARIOS[self.scenario], self.setting
        users = scenario.users(setting)
        with self._radio() as radio, scratch.folder("traffic") as folder:
            mover = SumoMover(users, scenario.network, folder, setting.seed, gui)
            try:
                for old in logs.glob("*.ndjson") if logs is not None else ():
                    old.unlink()
                traffic = Traffic(
                    scenario,
                    setting,
                    mover,
                    users,
                    radio,
                    logs=logs,
                    codec=codec(self.codec),
                    observe=frames.add if frames is not None else lambda traffic: None,
                )
                traffic.run(progress)
            finally:
                mover.close()
        return traffic

    def record(self, traffic: Traffic) -> dict[str, Any]:
        """What was run, and its statistics, for JSON."""
        radio = {"radio": self.radio} | ({"loss": self.loss} if self.radio == "even" else {})
        settings = {"scenario": self.scenario, **asdict(self.setting), **radio, "codec": self.codec}
        return {"setting": settings, **traffic.record()}

    @contextmanager
    def _radio(self) -> Iterator[RadioModel]:
        seed = self.setting.seed
        if self.radio == "even":
            yield EvenRadio(self.loss, seed)
        elif self.radio == "table":
            yield TableRadio(seed)
        else:
            try:
                radio = Ns3Radio(seed)
            except MissingExtra as error:
                raise TrafficError(str(error)) from None
            with closing(radio):
                yield radio


def wrong(record: dict[str, Any]) -> list[str]:
    """A line for everything in a record that must not happen: collisions between equipped vehicles,
    by a maneuver, or of an equipped vehicle with a pedestrian, and hazards that are unexcused (S-5)
    or exceed B (T-2)."""
    collisions, hazards = record["collisions"], record["hazards"] or {"wrong": []}
    counted = {
        "between equipped vehicles": collisions["between_equipped"],
        "by a maneuver": collisions["by_maneuver"],
        "of an equipped vehicle with a pedestrian": collisions["with_pedestrian"],
    }
    found = [f"{number} collisions {what}" for what, number in counted.items() if number]
    return found + [
        f"a hazard of {hazard['ms']} ms with {hazard['excuse'] or 'no'} excuse"
        for hazard in hazards["wrong"]
    ]
