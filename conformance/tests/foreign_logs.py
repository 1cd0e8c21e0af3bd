"""The logs that the station in C++ writes of itself: are they logs, are they allowed, and does that
of a station with a mistake show it?  Part of ``foreign.py``.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from automcm.links.simulated_radio import Channel
from automcm_maintenance.code_mutation import faults
from automcm_maintenance.code_mutation.cpp_station import SECONDS, SOURCE, build_mutant
from automcm_maintenance.code_mutation.faults import Fault
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight

Json = Any
AUTOMCM = Path(sys.executable).parent / "automcm"
CASES = (
    "AMCM/RCV/ADV/BV-01",
    "AMCM/PRE/END/BV-11",  # with a restart
    "AMCM/RCV/NEG/TI-04",  # these two with the timers that the parameters make
    "AMCM/PRE/NEG/TI-02",
)
MUTANT, ITS_CASE = "lease_runs_while_deciding", "AMCM/PRE/NEG/BV-03"
"""A timer runs on that should have been stopped (NEG-7): the station's own log says so at once,
before anything is sent too much."""
STATIONS = (1001, 2002)
RESTART = SOURCE.parents[2] / "traces/corpus/behaviours/restarts/005-1001.ndjson"
"""Of the corpus: a station restarts while its timers run."""


def unchanged() -> Fault:
    """The station as it is."""
    return Fault("unchanged", ())


def check_logs(folder: Path) -> str:
    """What is wrong with the logs of cases of the suite and of a replay; empty if nothing.

    Raises CalledProcessError and OSError.
    """
    station = build_mutant(unchanged(), folder)
    logs = driven(station, CASES, folder / "cases")
    return allowed(logs) or all_kinds(logs) or replayed(station, folder / "replay")


def check_mutant_log(folder: Path) -> tuple[str, str]:
    """The log and the rule at which the station with a mistake leaves the specification, in
    ``file:line`` and the rule's id; both empty if no log shows it.

    Raises CalledProcessError and OSError.
    """
    mutant = faults.load("cpp")[MUTANT]
    logs = driven(build_mutant(mutant, folder), [ITS_CASE], folder / "cases", code=1)
    diverging = [log for log in explained(logs) if log["verdict"] == "diverges"]
    rules = {log["rule"] for log in diverging}
    if not diverging or not rules <= set(mutant.notice["rules"]):
        print(f"{MUTANT}: its logs diverge at {sorted(rules)}", file=sys.stderr)
        return "", ""
    first = diverging[0]
    return f"{Path(first['file']).name}:{first['line']}", first["rule"]


def automcm(code: int, *arguments: str | Path) -> None:
    """Run the command, which must exit so.  Raises CalledProcessError."""
    command = [str(AUTOMCM), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
    if done.returncode != code:
        raise subprocess.CalledProcessError(
            done.returncode, command, done.stdout, done.stdout[-2000:] + done.stderr[-2000:]
        )


def driven(station: Path, selectors: Sequence[str], folder: Path, code: int = 0) -> list[Path]:
    """The logs that the station writes in these cases of the suite."""
    folder.mkdir(parents=True)
    own = ["--", station, "--log", folder / "log.ndjson"]
    automcm(code, "conform", "run", *selectors, "--out", folder / "report", *own)
    return sorted(folder.glob("*.ndjson"))


def explained(logs: Sequence[Path]) -> list[Json]:
    """What ``trace explain`` says of each.  Each is a run of its own, so its exit code, which is
    about all together, says nothing here."""
    report = logs[0].parent / "explained.json"
    out = ["--out", report.parent / "explained", "--json", report]
    command = [AUTOMCM, "trace", "explain", *out, *logs]
    subprocess.run(list(map(str, command)), capture_output=True, timeout=SECONDS)
    found: list[Json] = json.loads(report.read_text())["logs"]
    return found


def allowed(logs: Sequence[Path]) -> str:
    """Each keeps the format, and the specification allows it."""
    if len(logs) < 2:
        return f"{len(logs)} logs"
    automcm(0, "trace", "lint", *logs)
    for log in explained(logs):
        if log["verdict"] != "allowed":
            place = f"{Path(log['file']).name}:{log['line']}"
            return f"{place}: {log['verdict']} {log['event']} {log['rule']}"
    return ""


def all_kinds(logs: Sequence[Path]) -> str:
    """Nothing is lost, no kind of event is missing in all, and some headers tell the durations."""
    seen: Counter[str] = Counter()
    for path in logs:
        records = list(map(json.loads, path.read_text().splitlines()))
        seen["durations"] += "t_timeout" in records[0]["parameters"]
        seen["lost"] += records[-1].get("lost_records", 1)
        seen.update(r["ev"] + r.get("op", "") for r in records[1:-1])
    effects = ("send", "timerarm", "timerstop", "timerexpire", "indication")
    wanted = {"receive", "command", "restart", "durations", *effects}
    if missing := wanted - set(+seen):
        return f"in no log: {', '.join(sorted(missing))}"
    return f"{seen['lost']} events are lost" if seen["lost"] else ""


def replayed(station: Path, folder: Path) -> str:
    """Logs of others, replayed: the station logs what the kit logs of it, message by message and
    timer by timer, and the specification allows it."""
    folder.mkdir(parents=True)
    for log in (*simulated(folder), RESTART):
        own = folder / f"own-{log.name}"
        automcm(0, "trace", "replay", log, "--out", folder, "--", station, "--log", own)
        automcm(0, "trace", "lint", own)
        automcm(0, "trace", "explain", own)
        of_kit, of_station = (deeds(p) for p in (folder / f"{log.stem}-replayed.ndjson", own))
        if not of_kit or of_kit != of_station:
            kit_only, own_only = of_kit - of_station, of_station - of_kit
            return f"replay of {log.name}: the kit alone has {kit_only}, the station {own_only}"
    return ""


def simulated(folder: Path) -> list[Path]:
    """The logs of a session of two stations of the reference that lose messages."""
    simulation = Simulation(seed=3, channel=Channel(loss=0.2), logs=folder)
    for number in STATIONS:
        simulation.add(number, Straight())
    simulation.request(STATIONS[0], at=500)
    simulation.run(until=10_000)
    return [folder / f"{number}.ndjson" for number in STATIONS]


def deeds(path: Path) -> Counter[str]:
    """What it sent and what its timers did, each with its time.  CAMs fall due between the times
    at which the kit looks, so they stand without theirs."""
    found: Counter[str] = Counter()
    for record in map(json.loads, path.read_text().splitlines()):
        if record.get("ev") in ("send", "timer"):
            names = ("t_ms", "op", "timer", "deadline", "message")
            deed = {name: record[name] for name in names if name in record}
            if deed.get("message", {}).get("type") == "CAM":
                del deed["t_ms"]
            found[json.dumps(deed, sort_keys=True)] += 1
    return found
