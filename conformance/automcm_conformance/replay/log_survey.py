"""A log read once before its inputs are replayed: whether it can be, and with which parameters."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from automcm_conformance.adapter.protocol import DEFAULTS
from automcm_spec.vocabulary.messages import LIMIT
from automcm_traces.checker.track import CannotTell
from automcm_traces.format.log import (
    ApplicationCommand,
    ApplicationIndication,
    End,
    Event,
    Header,
    Receive,
    Restart,
    Send,
    TimerArm,
)
from automcm_traces.format.reader import Notice, records

LONGEST_MS = 24 * 3_600_000
"""The longest time without an event that is replayed."""
_ARMED = {"resend": "t_resend", "decide": "t_decide", "cam": "t_cam_loss"}
"""Timers that last as long as a parameter says."""


@dataclass(slots=True)
class Survey:
    """What is known of a log before it is replayed."""

    path: Path
    header: Header
    first_ms: int = 0
    last_ms: int = 0
    longest_ms: int = 0
    """The longest time between two events."""
    inputs: int = 0
    whole: bool = True
    """It holds all that was sent, so that what another station sends can be compared."""
    indications: bool = True
    """It holds all indications."""
    numbers: list[int] = field(default_factory=list)
    """Of its own sessions, ascending; empty if ``whole``, since what was sent says it then."""
    backoffs: list[int] = field(default_factory=list)
    """How long each back-off lasted, in ms."""
    armed: dict[str, int] = field(default_factory=dict)
    """Parameters that the header does not tell, and timers do."""
    warnings: list[str] = field(default_factory=list)
    """What the reader had to overlook."""

    def parameters(
        self, fixed: Mapping[str, int], features: Collection[str]
    ) -> tuple[dict[str, int], list[str]]:
        """Those to replay with, and in words where they are not those of the log.

        The header goes first, then timers, then the defaults; what is ``fixed`` stays, and
        ``clock_drift`` needs the feature.  Raises CannotTell if a station cannot be given them.
        """
        known = self.header.known
        found = {n: known.get(n, self.armed.get(n, ms)) for n, ms in DEFAULTS.items()}
        if self.backoffs:
            found["backoff_min"] = min(found["backoff_min"], *self.backoffs)
            found["backoff_max"] = max(found["backoff_max"], *self.backoffs)
        out = found | {str(name): value for name, value in fixed.items()}
        for name, value in out.items():
            if not (0 if name == "t_timeout" else 1) <= value <= LIMIT:
                raise CannotTell(f"header: {name} {value}: no station can be given that")
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


def events(path: Path) -> Iterator[tuple[int, Event | None, End | str | Header]]:
    """Each record of a log with its line: an event, or header, end and warning.

    Raises BadInput.
    """
    for entry in records(path):
        record = entry.record
        if isinstance(record, Notice):
            yield entry.line, None, f"{path}:{entry.line}: {record.problem}"
        elif isinstance(record, Header | End):
            yield entry.line, None, record
        else:
            yield entry.line, record, ""


def survey(path: Path) -> Survey:
    """Read a log to its end.  Raises BadInput."""
    found: Survey | None = None
    numbers: set[int] = set()
    for _, event, other in events(path):
        if isinstance(other, Header):
            found = Survey(path, other)
            found.whole = "send" in other.complete
            found.indications = "indication" in other.complete
            continue
        assert found is not None, "the header comes first"
        if event is None:
            if isinstance(other, str):
                found.warnings.append(other)
            elif isinstance(other, End) and other.lost_records:
                found.warnings.append(f"{path}: the log lost {other.lost_records} records")
                found.whole = found.indications = False
            continue
        if event.seq == 1:
            found.first_ms = found.last_ms = event.t_ms
        found.longest_ms = max(found.longest_ms, event.t_ms - found.last_ms)
        found.last_ms = event.t_ms
        _look(found, event, numbers)
    assert found is not None
    found.numbers = [] if found.whole else sorted(numbers)
    return found


def possible(found: Survey) -> None:
    """Raises CannotTell if the adapter protocol has no way to give these inputs."""
    if not found.inputs:
        raise CannotTell("the log holds no input")
    if found.longest_ms > LONGEST_MS:
        raise CannotTell(f"nothing is logged for {found.longest_ms} ms; that is not replayed")


def _look(found: Survey, event: Event, numbers: set[int]) -> None:
    match event:
        case Receive() | Restart():
            found.inputs += 1
        case ApplicationCommand(command=said) | ApplicationIndication(indication=said):
            found.inputs += isinstance(event, ApplicationCommand)
            _own(found, (said.model_extra or {}).get("session"), numbers)
        case Send(message=m) if m["type"] == "Advertisement":
            _own(found, m.get("session"), numbers)
        case TimerArm(timer=timer, deadline=deadline, t_ms=now):
            lasts = deadline - now
            if timer.name == "backoff" and lasts > 0:
                found.backoffs.append(lasts)
            elif timer.name in _ARMED and lasts > 0:
                found.armed.setdefault(_ARMED[timer.name], lasts)
            elif timer.name == "giveup" and lasts > 0 and "t_resend" in found.armed:
                found.armed.setdefault("t_timeout", max(0, lasts - found.armed["t_resend"]))
        case _:
            pass


def _own(found: Survey, session: object, numbers: set[int]) -> None:
    match session:
        case [int(p), int(number)] if p == found.header.station:
            numbers.add(number)
        case _:
            pass
