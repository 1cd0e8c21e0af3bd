"""The engine: what it loads, what it follows beyond any graph, and what it cannot conclude."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from automcm.core.station import Station
from automcm.links.clock import VirtualClock
from automcm.service import event_log
from automcm.service.service import McService
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import LANE_CHANGE, Straight
from automcm_spec.log_format.reader import Log, read
from automcm_spec.log_format.writer import LogWriter
from automcm_spec.vocabulary.messages import Cam, encode
from automcm_spec.vocabulary.parameters import Parameters, in_header
from automcm_traces.checker.engine import Engine
from automcm_traces.checker.track import CannotTell
from automcm_traces.explain.explain import explain, verdicts_of

CORPUS = Path(__file__).resolve().parents[2] / "corpus"


def a_log() -> Log:
    """A complete log in which something is sent."""
    return read(CORPUS / "pair" / "1001.ndjson")


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("name", "verdict"),
    [("pair/1001.ndjson", "allowed"), ("bad/accepts_unasked.ndjson", "diverges")],
)
def test_no_log_loads_a_graph(name: str, verdict: str) -> None:
    """The first answer comes in 0.3 s of CPU, with 40 MB; a graph takes 200."""
    code = (
        "import sys\n"
        "from automcm_traces.explain.explain import verdict_of\n"
        "print(verdict_of(sys.argv[1]).verdict)\n"
        "print('automcm_spec.graph.oracle' in sys.modules)\n"
        "print(next(line for line in open('/proc/self/status') if 'VmHWM' in line))\n"
    )
    command = [sys.executable, "-c", code, str(CORPUS / name)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    said, graphs, most = done.stdout.strip().splitlines()
    assert (said, graphs) == (verdict, "False")
    assert int(most.split()[1]) < 80 * 1024  # KiB


def test_where_a_message_may_be_missing_nothing_is_concluded_from_it() -> None:
    log = a_log()
    header = log.header.model_copy(update={"complete": ("command", "receive")})
    engine = Engine(header)
    with pytest.raises(CannotTell, match="line 2: the log does not contain: send Advertisement"):
        for at, event in log.events:
            if event.ev in header.complete:
                engine.feed(at, event)


ALL = ("command", "indication", "receive", "restart", "send", "timer")


def alone(folder: Path, parameters: Parameters, **commands: Any) -> Path:
    """The log of a prescriber with one receiver, and what else is done: name to (ms, what)."""
    simulation = Simulation(logs=folder)
    simulation.add(1, Straight(think_ms=400), parameters)
    simulation.add(2, Straight(), parameters)
    simulation.request(1, at=0)
    for ms, what in commands.values():
        simulation.clock.at(ms, lambda what=what: what(simulation.services[1]))
    simulation.run(6000)
    return folder / "1.ndjson"


def test_end_8_timers_due_before_a_restart_are_lost_and_not_missed(tmp_path: Path) -> None:
    clock = VirtualClock()
    path = tmp_path / "1.ndjson"
    station = Station(1)
    with LogWriter(
        path,
        run="r",
        station=1,
        implementation="automcm",
        version="0",
        parameters=in_header(station.parameters.known),
        complete=event_log.COMPLETE,
    ) as log:
        for effects in (station.command(LANE_CHANGE, clock.now()), station.restart(5000)):
            for effect in effects:
                event_log.write(log, effect, [f"1:{n}" for n in range(1, 1 + len(effect.messages))])
    assert explain(read(path)).verdict == "allowed"


def test_act_5_an_own_cam_as_an_echo_is_nobody_s(tmp_path: Path) -> None:
    def echo(service: McService) -> None:
        cam = Cam(
            src=1, generation_ms=3000, x_mm=0, y_mm=0, heading_mrad=0, speed_mm_s=0, marks=((1, 1),)
        )
        service.receive(encode(cam))

    path = alone(tmp_path, Parameters(), first=(1000, echo), second=(3000, echo))
    assert explain(read(path)).verdict == "allowed"


@pytest.mark.parametrize(("length_mm", "verdict"), [(4500, "allowed"), (0, "diverges")])
def test_a_logged_cam_may_state_an_extent(tmp_path: Path, length_mm: int, verdict: str) -> None:
    def hear(service: McService) -> None:
        zeros = dict.fromkeys(("x_mm", "y_mm", "heading_mrad", "speed_mm_s", "generation_ms"), 0)
        extent = {"length_mm": 4500, "width_mm": 1800, "station_type": 5, "sigma_mm": 300}
        service.receive(encode(Cam.model_validate({"src": 2, "marks": ()} | zeros | extent)))

    path = alone(tmp_path, Parameters(), first=(1000, hear))
    path.write_text(path.read_text().replace('"length_mm":4500', f'"length_mm":{length_mm}'))
    assert explain(read(path)).verdict == verdict


def test_pre_5_a_choice_without_a_proposal_is_a_wrong_one(tmp_path: Path) -> None:
    """The station refuses it, and nothing else follows."""
    with LogWriter(
        tmp_path / "1.ndjson", run="r", station=1, implementation="x", version="1", complete=ALL
    ) as log:
        for name in ("prescribe", "accept", "refuse"):
            log.event("command", 10, command={"name": name, "session": [1, 1], "proposal": 0})
            log.event("indication", 10, indication={"name": "refused"})
    assert verdicts_of([tmp_path / "1.ndjson"])[0].verdict == "allowed"
