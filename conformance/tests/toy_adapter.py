"""An adapter of a toy: not a station, but it makes no mistake in the protocol."""

import json
import sys

ABOUT = {
    "protocol": 1,
    "name": "toy",
    "version": "1",
    "issues": "nowhere",
    "scenarios": ["merge"],
    "features": ["prescriber", "receiver", "restart", "durations"],
    "fixed": {"t_cam": 50},
}
known = {"reset", "receive", "command", "advance", "restart", "durations"}
number, me, window, resend, deadline = 0, 0, 300, 100, None


def answer(line):
    global number, me, window, resend, deadline
    cmd, messages, told = line["cmd"], [], []
    if cmd == "hello":
        return ABOUT
    if cmd not in known:
        raise ValueError("unknown")
    if cmd == "durations":
        window = line["durations"]["advertise"]
    now = line.get("now")
    if now is not None and deadline is not None and deadline <= now:
        deadline = None
    if cmd == "reset":
        assert line["parameters"]["t_cam"] == 50
        number, me, window, deadline = 0, line["station"], 300, None
    elif cmd == "receive":
        message, planned = line["message"], line.get("planned")
        if message.get("type") == "Advertisement" and planned:
            messages.append({"type": "Intention", "planned": planned})
    elif cmd == "command" and line["command"]["name"] == "request":
        assert line["command"]["scenario"] == "merge"
        number += 1
        deadline = now + window
        messages.append({"type": "Advertisement", "session": [me, number], "seq": 1})
    elif cmd == "command":
        told.append({"name": "refused", "rule": "CMD-1"})
    return {"messages": messages, "indications": told, "deadline": deadline}


for line in sys.stdin:
    try:
        command = json.loads(line)
        if command["cmd"] == "stop":
            break
        out = answer(command)
    except (ValueError, KeyError, TypeError) as error:
        out = {"error": repr(error)}
    print(json.dumps(out), flush=True)
