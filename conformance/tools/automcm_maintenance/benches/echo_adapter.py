"""The baseline of ``automcm bench conform``: an adapter with a constant answer to each line."""

from __future__ import annotations

import json
import sys

HELLO = {
    "protocol": 1,
    "name": "echo",
    "version": "1",
    "issues": "none: it is no station",
    "features": ["prescriber", "receiver", "restart", "durations", "cam", "clock_drift"],
    "scenarios": ["lane_change"],
    "fixed": {},
}
ANSWER: dict[str, object] = {
    "messages": [],
    "indications": [],
    "deadline": None,
    "phase": "STANDALONE",
}


def main() -> None:
    """Answer lines until ``stop``."""
    for line in sys.stdin.buffer:
        command = json.loads(line)
        if command["cmd"] == "stop":
            return
        print(json.dumps(HELLO if command["cmd"] == "hello" else ANSWER), flush=True)


if __name__ == "__main__":
    main()
