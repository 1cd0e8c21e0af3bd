"""Writes the reference's log: the inputs and effects of a station as events of automcm.trace/1."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from automcm.core.outcome import Expiry, Received, ReceivedCam, Restart
from automcm.core.state import Timer
from automcm.core.station import Effects
from automcm.encoding.codec import FRAME_BYTES
from automcm_spec.log_format.writer import LogWriter, Sink
from automcm_spec.vocabulary.messages import to_dict
from automcm_spec.vocabulary.parameters import Parameters, in_header

VERSION = metadata.version("automcm")
COMPLETE = ("command", "indication", "receive", "restart", "send", "timer")


def open_log(
    target: str | Path | Sink,
    station_id: int,
    parameters: Parameters | None = None,
    *,
    run: str,
    name: str = "",
) -> LogWriter:
    """The log of one service of this implementation, for ``McService``.

    ``run`` names the run, ``name`` the station.
    Logs of stations of one run have the same ``run``.  Raises OSError if it cannot be written.
    """
    return LogWriter(
        target,
        run=run,
        station=station_id,
        implementation="automcm",
        version=VERSION,
        parameters=in_header((parameters or Parameters()).known),
        complete=COMPLETE,
        validated=False,  # test_simulation.py compares the lines with validated ones
        name=name,
    )


def timer(t: Timer) -> dict[str, Any]:
    """A timer in the form of the log."""
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
    """Write one input and its effects.

    ``txs`` are the transmission ids of the sent messages.  ``tx`` is the transmission id of the
    received message, and ``raw`` its bytes if they were not a valid message.
    """
    t_ms = effects.now_ms
    more: dict[str, Any] = {"phase": effects.state.phase, "role": effects.state.role}
    more["late_ms"] = late_ms
    if effects.rule:
        more["rule"] = effects.rule
    match effects.input:
        case None:
            log.event("receive", t_ms, tx=tx, raw=_raw(raw), **more)
        case Received(message, planned):
            plan = planned and planned.model_dump(mode="json")
            log.event("receive", t_ms, tx=tx, message=to_dict(message), planned=plan, **more)
        case ReceivedCam(cam):
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
        record = {"name": indication.name, "rule": effects.rule} | indication.as_dict()
        log.event("indication", t_ms, indication=record)


def write_rejected(log: LogWriter, t_ms: int, reason: str, data: bytes, tx: str | None) -> None:
    """Write a datagram that a secured link discarded for ``reason``."""
    log.event("receive", t_ms, tx=tx, raw=_raw(data), rejected=reason)


def _raw(data: bytes) -> str:
    """The first bytes of what is no message: anybody may send it, so it must not fill the log."""
    return base64.b64encode(data[:FRAME_BYTES]).decode()
