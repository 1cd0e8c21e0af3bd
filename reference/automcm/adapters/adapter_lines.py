"""The reference behind the conformance kit: lines in, lines out (docs/adapter.md).

``python -m automcm.adapters.adapter_lines`` needs no extra.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from importlib.metadata import version
from typing import Any

from pydantic import ValidationError
from pydantic_core import from_json, to_json

from automcm.core.station import Effects, Station
from automcm_spec.vocabulary.application import COMMAND, Discarded, Indication, Refused
from automcm_spec.vocabulary.messages import Cam, MessageError, Trajectory, decode, encode, to_dict
from automcm_spec.vocabulary.parameters import TIMERS, Parameters

Json = Any
PROTOCOL = 1
HELLO = {
    "protocol": PROTOCOL,
    "name": "automcm reference",
    "version": version("automcm"),
    "issues": "see the README",
    "features": ["prescriber", "receiver", "restart", "durations", "cam", "clock_drift"],
    "scenarios": ["lane_change", "merge", "speed_advice"],
    "fixed": {},
}


class Kit:
    """One station, driven by commands.  ``answer`` raises KeyError, TypeError, ValueError."""

    def __init__(self) -> None:
        self._station: Station | None = None
        self._planned: Trajectory | None = None
        self._t_cam = 0
        self._cam_ms = 0

    def answer(self, command: dict[str, Json]) -> dict[str, Json]:
        """The answer to one command other than ``stop``."""
        match command["cmd"]:
            case "hello":
                if command["protocol"] != PROTOCOL:
                    raise ValueError(f"protocol must be {PROTOCOL}, not {command['protocol']}")
                return HELLO
            case "reset":
                return self._reset(command)
            case "durations":
                self._last(command["durations"])
                return self._answer_line([], [])
            case "receive" | "command" | "advance" | "restart" as name:
                now = command["now"]
                cams = self._cams(now)
                return self._answer_line(getattr(self, f"_{name}")(command, now), cams)
        raise ValueError(f"unknown command: {command['cmd']!r}")

    @property
    def _started(self) -> Station:
        if self._station is None:
            raise ValueError("no station: the command reset must come first")
        return self._station

    def _last(self, durations: dict[str, int]) -> None:
        for name, ms in durations.items():
            if name not in TIMERS or name == "lease" or type(ms) is not int or ms < 1:
                raise ValueError(
                    f"durations: expected a timer other than lease with a positive integer of ms, "
                    f"not {name}: {ms}"
                )
        self._started.durations = {**self._started.durations, **durations}

    def _reset(self, command: dict[str, Json]) -> dict[str, Json]:
        parameters = Parameters(**({"clock_drift": 0} | command["parameters"]))
        self._station = Station(
            command["station"], parameters, plan=lambda _: self._planned, seed=command["seed"]
        )
        self._station.advance(command["now"])
        self._t_cam = parameters.t_cam
        self._cam_ms = command["now"] + self._t_cam
        return self._answer_line([], [])

    def _receive(self, command: dict[str, Json], now: int) -> list[Effects]:
        planned = command.get("planned")
        self._planned = None if planned is None else Trajectory.model_validate(planned)
        data = to_json(command["message"])
        try:
            return self._started.receive(decode(data), now)
        except MessageError:
            return self._started.receive(data, now)

    def _command(self, command: dict[str, Json], now: int) -> list[Effects]:
        return self._started.command(COMMAND.validate_python(command["command"]), now)

    def _advance(self, command: dict[str, Json], now: int) -> list[Effects]:
        return self._started.advance(now)

    def _restart(self, command: dict[str, Json], now: int) -> list[Effects]:
        return self._started.restart(now)

    def _cams(self, now: int) -> list[dict[str, Json]]:
        """The CAMs that are due up to ``now``; they come before all other effects."""
        cams, station = [], self._started
        while self._cam_ms <= now:
            cam = Cam(
                src=station.station_id,
                generation_ms=self._cam_ms,
                x_mm=0,
                y_mm=0,
                heading_mrad=0,
                speed_mm_s=0,
                marks=station.state.marks,
            )
            cams.append(to_dict(cam))
            self._cam_ms += self._t_cam
        return cams

    def _answer_line(self, effects: list[Effects], cams: list[dict[str, Json]]) -> dict[str, Json]:
        answer: dict[str, Json] = {
            "messages": [from_json(encode(m)) for each in effects for m in each.messages],
            "indications": [_indication_line(i, e.rule) for e in effects for i in e.indications],
            "deadline": self._started.next_deadline(),
            "phase": self._started.state.phase,
        }
        if cams:
            answer["cams"] = cams
        return answer


def _indication_line(indication: Indication, rule: str) -> dict[str, Json]:
    """An indication in the form of the adapter protocol."""
    out = indication.model_dump(mode="json") | {"rule": rule}
    return out | (
        {"detail": indication.detail} if isinstance(indication, Refused | Discarded) else {}
    )


def serve(lines: Iterable[bytes]) -> Iterator[bytes]:
    """The answer to each line, until ``stop``."""
    kit = Kit()
    for line in lines:
        try:
            command = from_json(line)
            if command["cmd"] == "stop":
                return
            answer = kit.answer(command)
        except ValidationError as error:
            answer = {"error": str(error.errors(include_url=False)[0]["msg"])}
        except (KeyError, TypeError, ValueError) as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        yield to_json(answer) + b"\n"


def main() -> None:
    """Answer standard input on standard output, until ``stop``."""
    out = sys.stdout.buffer
    for answer in serve(sys.stdin.buffer):
        out.write(answer)
        out.flush()


if __name__ == "__main__":
    main()
