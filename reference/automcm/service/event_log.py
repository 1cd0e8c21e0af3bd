"""The reference writes logs: what a station did, as events of automcm.trace/1."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

from automcm.core.outcome import Expiry, Heard, Restart
from automcm.core.state import Timer
from automcm.core.station import Effects
from automcm_spec.vocabulary.messages import Cam, to_dict
from automcm_traces.format.writer import LogWriter

COMPLETE = ("command", "indication", "receive", "restart", "send", "timer")


def timer(t: Timer) -> dict[str, Any]:
    """A timer as the log names it."""
    out: dict[str, Any] = {"name": t.name}
    if t.entry is not None:
        out["message"] = {"type": t.entry.type}
        if t.entry.to:
            out["message"]["to"] = t.entry.to
        out["message"] |= {"session": list(t.entry.session), "seq": t.entry.seq}
    if t.station:
        out["station"] = t.station
    return out


def write(
    log: LogWriter,
    effects: Effects,
    txs: Sequence[str],
    *,
    tx: str | None = None,
    raw: bytes = b"",
    late_ms: int | None = None,
) -> None:
    """One input and its effects.  ``txs`` are the transmission ids of the messages sent, ``tx``
    is that of the message received, ``raw`` its bytes if they were no message."""
    t_ms = effects.now_ms
    more: dict[str, Any] = {"phase": effects.state.phase, "role": effects.state.role}
    more["late_ms"] = late_ms
    if effects.rule:
        more["rule"] = effects.rule
    match effects.input:
        case None:
            log.event("receive", t_ms, tx=tx, raw=base64.b64encode(raw).decode(), **more)
        case Heard(message, planned):
            plan = planned and planned.model_dump(mode="json")
            log.event("receive", t_ms, tx=tx, message=to_dict(message), planned=plan, **more)
        case Cam() as cam:
            log.event("receive", t_ms, tx=tx, message=to_dict(cam), **more)
        case Expiry(expired):
            log.event("timer", t_ms, op="expire", timer=timer(expired), **more)
        case Restart():
            log.event("restart", t_ms, **more)
        case command:
            fields = command.model_dump(mode="json", exclude_none=True)
            log.event("command", t_ms, command=fields, **more)
    for message, own in zip(effects.messages, txs, strict=True):
        log.event("send", t_ms, tx=own, message=to_dict(message))
    for stopped in effects.stopped:
        log.event("timer", t_ms, op="stop", timer=timer(stopped))
    for armed, deadline in effects.armed:
        log.event("timer", t_ms, op="arm", timer=timer(armed), deadline=deadline)
    for indication in effects.indications:
        told = {"name": indication.name, "rule": effects.rule} | indication.as_dict()
        log.event("indication", t_ms, indication=told)
