"""Random behaviours of a closed model, as TLC's simulation mode walks them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from automcm_spec import scratch, tlc, values
from automcm_spec.oracle import STATE_FIELDS
from automcm_spec.paths import TLA

Json = Any

CONFIG = """CONSTANTS
  MaxRounds = 3
  MaxParticipants = 3
  OutboxLimit = 12
  MemoryLimit = 4
  Stations = {{1, 2, 3, 4}}
  Prescribers = {{1, 2}}
  Receivers = {{1, 2, 3, 4}}
  Restarters = {{2, 4}}
  MaxSessions = 2
  Forgetting = FALSE
  Reduced = FALSE
SPECIFICATION {spec}
CHECK_DEADLOCK FALSE
INVARIANTS TypeInv AcceptedInv AgreementInv NoHazardInv
"""
"""Four stations, two of them in either role, nothing reduced: too large to exhaust."""

CONSTANTS = {"MaxRounds": 3, "MaxParticipants": 3, "OutboxLimit": 12, "MemoryLimit": 4}

_ENTRY = ("type", "to", "session", "seq", "accepted")
_MESSAGE = ("type", "src", "dst", "session", "seq", "proposal", "accepted", "reason", "of")


def _plain(value: values.Value) -> Json:
    """Tuples and sets as lists, as in the oracle."""
    if isinstance(value, tuple):
        return [_plain(v) for v in value]
    if isinstance(value, frozenset):
        return sorted((_plain(v) for v in value), key=str)
    return value


def _record(value: Any, fields: Sequence[str]) -> Json:
    return [_plain(value[name]) for name in fields]


def state(value: Any) -> Json:
    """A station of a closed model in the form of the oracle, with the model's ids."""
    out = _record(value | {"outbox": frozenset()}, STATE_FIELDS)
    out[11] = [_record(entry, _ENTRY) for entry in value["outbox"]]
    return out


def message(value: Any) -> Json:
    """A message of a closed model in the form of the oracle."""
    return _record(value, _MESSAGE)


def input_(value: Any) -> Json:
    """An input of a closed model in the form of the oracle, with the model's ids."""
    match value["kind"]:
        case "receive":
            return ["receive", message(value["message"]), value["concerned"]]
        case "cam":
            return ["cam", value["src"], _plain(value["marks"]), value["newer"]]
        case "command":
            return ["command", *_record(value, ("name", "session", "proposal", "target"))]
        case "expire":
            timer = value["timer"]
            about = [_record(e, _ENTRY) if isinstance(e, dict) else e for e in timer[1:]]
            return ["expire", [timer[0], *about]]
    return [value["kind"]]


def behaviours(
    number: int, depth: int, seed: int, *, lively: bool = False, tla: Path = TLA
) -> list[list[tuple[int, Json, Json]]]:
    """``number`` behaviours of ``depth`` steps, each a list of (station, input, its next state).

    The same seed gives the same behaviours.  ``lively`` leaves out what ends sessions early
    (Simulation.tla).  Raises tlc.TlcError.
    """
    with scratch.folder("simulate") as folder:
        cfg = folder / "Simulated.cfg"
        cfg.write_text(CONFIG.format(spec="LivelySpec" if lively else "AnySpec"))
        prefix = folder / "trace"
        extra = ["-simulate", f"file={prefix},num={number}", "-depth", str(depth)]
        tlc.run("Simulation", cfg, tla_dir=tla, extra=[*extra, "-seed", str(seed)])
        files = sorted(folder.glob("trace_*"), key=_place)
        return [_behaviour(path.read_text()) for path in files]


def _place(path: Path) -> list[int]:
    return [int(n) for n in path.name.split("_")[1:]]


def _behaviour(text: str) -> list[tuple[int, Json, Json]]:
    steps = []
    for part in text.split("\nSTATE_")[2:]:
        body = part.split("==", 1)[1].split("\n\n")[0].split("====")[0]
        found = values.parse_state(body.strip())
        last: Any = found["last"]
        stations: Any = found["st"]
        who = last["station"]
        steps.append((who, input_(last["input"]), state(stations[who - 1])))
    return steps
