"""An adapter for the AutoMCM conformance kit: from lines to your station and back.

    automcm conform check-adapter -- ./run      # is each line right?
    automcm conform run -- ./run                # is the station right?

It speaks the whole protocol; the station in it does nothing yet.  Go through the TODOs.
"""

from __future__ import annotations

import json
import sys
from typing import Any

Json = dict[str, Any]

ABOUT: Json = {
    "protocol": 1,
    "name": "my station",  # TODO
    "version": "0.1",  # TODO
    "issues": "where to report a bug in it",  # TODO
    "features": ["prescriber", "receiver"],  # TODO: restart, durations, cam
    "scenarios": ["lane_change"],  # TODO: what it takes in a request
    "fixed": {},  # TODO: parameters that it cannot change, such as {"t_resend": 100}
}


class Station:
    """TODO: your station in the place of this one, which hears nothing and says nothing."""

    def __init__(self, now: int, station_id: int, seed: int, parameters: Json) -> None:
        self.messages: list[Json] = []  # TODO: put here what is sent, as JSON objects
        self.indications: list[Json] = []  # TODO: and here what the application is told

    def advance(self, now: int) -> None:
        """TODO: fire each timer that is due at ``now`` or was before, in the order of time."""

    def receive(self, message: Json, planned: Json | None) -> None:
        """TODO: a message; without ``planned`` an Advertisement does not concern the station."""

    def command(self, name: str, command: Json) -> None:
        """TODO: request, prescribe, proceed, complete, abort, accept or refuse."""

    def deadline(self) -> int | None:
        """TODO: the time (not the duration) at which the next timer is due; None if none is."""
        return None

    def answer(self) -> Json:
        """All that happened since the last answer."""
        messages, self.messages = self.messages, []
        indications, self.indications = self.indications, []
        # TODO: add "phase" if the station can tell it.
        return {"messages": messages, "indications": indications, "deadline": self.deadline()}


class Adapter:
    """Turns a command into calls of the station."""

    def __init__(self) -> None:
        self.station: Station | None = None

    def answer(self, line: Json) -> Json:
        """The answer to a line."""
        cmd = line["cmd"]
        if cmd == "hello":
            return ABOUT
        if cmd == "reset":
            now, station_id, seed = line["now"], line["station"], line["seed"]
            self.station = Station(now, station_id, seed, line["parameters"])
            return self.station.answer()
        if self.station is None:
            raise ValueError("reset comes first")
        if cmd not in ("receive", "command", "advance"):
            raise ValueError(f"unknown command {cmd!r}")
        self.station.advance(line["now"])  # timers before anything else of the same instant
        if cmd == "receive":
            self.station.receive(line["message"], line.get("planned"))
        elif cmd == "command":
            self.station.command(line["command"]["name"], line["command"])
        return self.station.answer()


def main() -> None:
    """Answer each line until ``stop`` or the end of the input."""
    adapter = Adapter()
    for line in sys.stdin:
        try:
            command = json.loads(line)
            if command["cmd"] == "stop":
                return
            answer = adapter.answer(command)
        except (ValueError, KeyError, TypeError) as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)  # print anything else to sys.stderr


if __name__ == "__main__":
    main()
