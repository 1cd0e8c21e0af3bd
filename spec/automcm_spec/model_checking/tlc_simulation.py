"""Random behaviours of a closed model, from TLC's simulation mode."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from automcm_spec.model_checking import tla_values, tlc
from automcm_spec.support import scratch
from automcm_spec.vocabulary import json_forms
from automcm_spec.vocabulary.station import Input, State

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
"""Four stations, two of them in either role, without reductions: too large to check
exhaustively."""

CONSTANTS = {"MaxRounds": 3, "MaxParticipants": 3, "OutboxLimit": 12, "MemoryLimit": 4}

Behaviour = list[tuple[int, Input, State]]
"""Steps: station, input, next state."""

state, input_of, timer_of = json_forms.state, json_forms.input_of, json_forms.timer
"""What a model prints of stations, inputs and timers, with the model's ids."""


def behaviours(number: int, depth: int, seed: int, *, lively: bool = False) -> list[Behaviour]:
    """``number`` behaviours of ``depth`` steps.

    Equal seeds give equal behaviours. ``lively`` excludes inputs that end sessions early
    (Simulation.tla). Raises tlc.TlcError.
    """
    with scratch.folder("simulate") as folder:
        cfg = folder / "Simulated.cfg"
        cfg.write_text(CONFIG.format(spec="LivelySpec" if lively else "AnySpec"))
        prefix = folder / "trace"
        extra = ["-simulate", f"file={prefix},num={number}", "-depth", str(depth)]
        tlc.run("Simulation", cfg, extra=[*extra, "-seed", str(seed)], short=True)
        files = sorted(folder.glob("trace_*"), key=_place)
        return [_behaviour(path.read_text()) for path in files]


def _place(path: Path) -> list[int]:
    return [int(n) for n in path.name.split("_")[1:]]


_WANTED = re.compile(r"^/\\ (?:last|st) = .*\n?(?:[^/].*\n?)*", re.MULTILINE)
"""The two variables that are read; the others take most of the time."""


def _behaviour(text: str) -> Behaviour:
    steps = []
    for part in text.split("\nSTATE_")[2:]:
        body = part.split("==", 1)[1].split("\n\n")[0].split("====")[0]
        found = tla_values.parse_state("".join(_WANTED.findall(body)).strip())
        last: Any = found["last"]
        stations: Any = found["st"]
        who = last["station"]
        steps.append((who, input_of(last["input"]), state(stations[who - 1])))
    return steps
