"""An adapter for the AutoMCM conformance kit: it translates lines to calls of your station.

    automcm conform check-adapter -- ./run      # is each line valid?
    automcm conform run -- ./run                # is the station correct?

It implements the whole adapter protocol, but the station is empty.  Work through the TODOs.
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
    "scenarios": ["lane_change"],  # TODO: scenarios that a request may name
    "fixed": {},  # TODO: parameters that cannot be changed, such as {"t_resend": 100}
}


class Station:
    """TODO: replace this with your station."""

    def __init__(self, now: int, station_id: int, seed: int, parameters: Json) -> None:
        self.messages: list[Json] = []  # TODO: add each message that is sent
        self.indications: list[Json] = []  # TODO: add each indication to the application

    def advance(self, now: int) -> None:
        """TODO: fire each timer due at ``now`` or earlier, as protocol.md section 3 orders them."""

    def receive(self, message: Json, planned: Json | None) -> None:
        """TODO: handle a message.  ``planned`` is None unless an Advertisement concerns you."""

    def command(self, name: str, command: Json) -> None:
        """TODO: handle request, close, prescribe, proceed, complete, abort, accept and refuse."""

    def deadline(self) -> int | None:
        """TODO: the time (not the duration) of the earliest armed timer, or None."""
        return None

    def answer(self) -> Json:
        """Everything since the last answer."""
        messages, self.messages = self.messages, []
        indications, self.indications = self.indications, []
        # TODO: add "phase" if the station can report it.
        return {"messages": messages, "indications": indications, "deadline": self.deadline()}


class Adapter:
    """Translates a command to calls of the station."""

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
        self.station.advance(line["now"])  # timers come before any other input of the instant
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
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), flush=True)  # print anything else to sys.stderr


if __name__ == "__main__":
    main()
