"""Reads a log before its inputs are replayed: can it be replayed, and with which parameters?"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from automcm_conformance.adapter.protocol import DEFAULTS
from automcm_spec.log_format.log import (
    ApplicationCommand,
    ApplicationIndication,
    Event,
    Header,
    Receive,
    Restart,
    Send,
    TimerArm,
)
from automcm_spec.log_format.reader import LogStream, records
from automcm_spec.vocabulary.messages import LIMIT, session_in
from automcm_traces.checker.log_start import MID_SESSION
from automcm_traces.checker.track import CannotTell

LONGEST_MS = 24 * 3_600_000
"""The longest gap between two events that is replayed."""
_ARMED = {"resend": "t_resend", "decide": "t_decide", "cam": "t_cam_loss"}
"""Timers whose duration is a parameter."""


@dataclass(slots=True)
class Survey:
    """Properties of a log that is to be replayed."""

    path: Path
    header: Header
    first_ms: int = 0
    last_ms: int = 0
    longest_ms: int = 0
    """The longest gap between two events."""
    inputs: int = 0
    complete: bool = True
    """Whether the log contains all messages sent."""
    numbers: list[int] = field(default_factory=list)
    """The station's own session numbers, ascending; not needed if the log is ``complete``."""
    backoffs: list[int] = field(default_factory=list)
    """The duration of each back-off in ms."""
    armed: dict[str, int] = field(default_factory=dict)
    """Parameters derived from the durations of timers."""
    warnings: list[str] = field(default_factory=list)
    """The warnings of the reader."""

    def parameters(
        self, fixed: Mapping[str, int], features: Collection[str]
    ) -> tuple[dict[str, int], list[str]]:
        """The parameters for the replay, and notes on those that differ from the log's.

        Taken from the header, else from timers, else the defaults.  ``fixed`` parameters keep
        their values, and ``clock_drift`` needs the feature.  Raises CannotTell for a value that no
        station accepts.
        """
        known = self.header.known
        found = {n: known.get(n, self.armed.get(n, ms)) for n, ms in DEFAULTS.items()}
        if self.backoffs:
            found["backoff_min"] = min(found["backoff_min"], *self.backoffs)
            found["backoff_max"] = max(found["backoff_max"], *self.backoffs)
        out = found | dict(fixed)
        for name, value in out.items():
            low = 0 if name == "t_timeout" else 1
            if not low <= value <= LIMIT:
                raise CannotTell(f"header: {name} {value} must be from {low} to {LIMIT}")
        others = self.armed | known
        notes = [
            f"{n} is {others[n]} in the log and fixed at {out[n]} in the station"
            for n in others
            if n in out and others[n] != out[n]
        ]
        drift = known.get("clock_drift", 0)
        if drift and "clock_drift" in features:
            out["clock_drift"] = drift
        elif drift:
            notes.append(f"clock_drift is {drift} in the log and 0 in the station")
        return out, notes


def survey(path: Path) -> Survey:
    """Read a log to its end.  Raises BadInput."""
    log = LogStream(path, entries=records(path))
    found = Survey(path, log.header, complete="send" in log.header.complete)
    numbers: set[int] = set()
    for _, event in log:
        if event.seq == 1:
            found.first_ms = found.last_ms = event.t_ms
        found.longest_ms = max(found.longest_ms, event.t_ms - found.last_ms)
        found.last_ms = event.t_ms
        _count(found, event, numbers)
    found.warnings += log.warnings
    if log.end is not None and log.end.lost_records:
        found.warnings.append(f"{path}: the log lost {log.end.lost_records} records")
        found.complete = False
    found.numbers = [] if found.complete else sorted(numbers)
    return found


def require_replayable(found: Survey) -> None:
    """Raises CannotTell if the log begins in mid-session, has no inputs, or too long a gap between
    events."""
    if found.header.begins is not None:
        raise CannotTell(f"{MID_SESSION}, and only a session from its start can be replayed")
    if not found.inputs:
        raise CannotTell("the log contains no input")
    if found.longest_ms > LONGEST_MS:
        raise CannotTell(
            f"the log has a gap of {found.longest_ms} ms without events;"
            f" gaps of more than {LONGEST_MS} ms are not replayed"
        )


def _count(found: Survey, event: Event, numbers: set[int]) -> None:
    match event:
        case Receive() | Restart():
            found.inputs += 1
        case ApplicationCommand(command=value) | ApplicationIndication(indication=value):
            found.inputs += isinstance(event, ApplicationCommand)
            _note_own(found, (value.model_extra or {}).get("session"), numbers)
        case Send(message=m) if m["type"] == "Advertisement":
            _note_own(found, m.get("session"), numbers)
        case TimerArm(timer=timer, deadline=deadline, t_ms=now):
            duration = deadline - now
            if timer.name == "backoff" and duration > 0:
                found.backoffs.append(duration)
            elif timer.name in _ARMED and duration > 0:
                found.armed.setdefault(_ARMED[timer.name], duration)
            elif timer.name == "giveup" and duration > 0 and "t_resend" in found.armed:
                found.armed.setdefault("t_timeout", max(0, duration - found.armed["t_resend"]))


def _note_own(found: Survey, session: object, numbers: set[int]) -> None:
    own = session_in(session)
    if own is not None and own[0] == found.header.station:
        numbers.add(own[1])
