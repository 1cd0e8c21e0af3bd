"""Finds the event from which on a log that begins in mid-session can be judged.

What the station did before is unknown: its session, and what outlives a session (Fin and Cancel in
the outbox, the sessions joined, quarantine, back-off). A restart forgets all that (END-8). So does
time: a station that is in no session, and opens and joins none for as long as any of it lasts, is
as new. Only the number of its last own session stays unknown, which nothing depends on.
"""

from __future__ import annotations

from collections.abc import Container

from automcm_spec.log_format.log import (
    ApplicationIndication,
    Event,
    Header,
    Restart,
    Send,
    Timer,
    TimerArm,
    TimerEnd,
)
from automcm_spec.vocabulary.parameters import DEFAULTS, Known, durations, forgotten_at

LEFT = ("fallback", "finished", "no_participants")
"""The indications of a step that ends in STANDALONE."""
OPENING = ("Advertisement", "Intention")
"""The messages that a station sends when it enters a session."""
OUTLIVING = ("backoff", "forget", "giveup", "quarantine")
"""The timers that outlive a session."""
MID_SESSION = "the log begins in mid-session"


class LogStart:
    """Looks at the events of a log that begins in mid-session, until its state is known."""

    def __init__(self, header: Header, late_ms: int | None = None) -> None:
        late = header.longest_delay if late_ms is None else late_ms
        lasts = remembered_for(header.known)
        self._wait = None if lasts is None else lasts + late
        self.since_ms: int | None = None
        """Since when the station is known to be in no session; None: not known."""
        self._restarting = False

    def known_before(self, event: Event) -> bool:
        """Whether the station is as new before this event; if not, take note of the event."""
        if isinstance(event, Restart):
            self.since_ms = event.t_ms
            return True
        since_ms, wait_ms = self.since_ms, self._wait
        forgotten = since_ms is not None and wait_ms is not None and event.t_ms > since_ms + wait_ms
        if _begins_step(event) and forgotten:
            return True
        if opens(event) or event.phase not in (None, "STANDALONE"):
            self.since_ms = None
        elif self.since_ms is None or (
            isinstance(event, TimerArm) and event.timer.name in OUTLIVING  # of a restart unlogged
        ):
            known = self.since_ms is not None or shows_standalone(event)
            self.since_ms = event.t_ms if known else None
        return False

    def is_left_over(self, event: Event, timers: Container[Timer]) -> bool:
        """Whether an event, judged with these timers armed, only ends a timer of before: a restart
        stops them all, and the specification does not say how long forget and backoff last."""
        if _begins_step(event):
            self._restarting = isinstance(event, Restart)
        if not isinstance(event, TimerEnd) or event.timer in timers:
            return False
        stopped = event.op == "stop" and self._restarting
        return stopped or event.timer.name in ("forget", "backoff")


def remembered_for(p: Known) -> int | None:
    """How long a station remembers anything of a session after it left it, in ms; None if the
    header lacks a parameter for this. A back-off lasts at most its default."""
    lasts = durations(p)
    giveup, quarantine = lasts["giveup"], lasts["quarantine"]
    if giveup is None or quarantine is None or not {"t_advertise", "t_life"} <= p.keys():
        return None
    return max(giveup, quarantine, forgotten_at(p, 0, 0), DEFAULTS["backoff_max"])


def shows_standalone(event: Event) -> bool:
    """Whether an event shows that the station is in no session after its step."""
    match event:
        case Send(message={"type": "CAM", "marks": []}):  # ACT-5
            return True
        case ApplicationIndication(indication=told) if told.name in LEFT:
            return True
    return event.phase == "STANDALONE"


def opens(event: Event) -> bool:
    """Whether the station enters a session."""
    return isinstance(event, Send) and event.message["type"] in OPENING


def _begins_step(event: Event) -> bool:
    """Whether a step begins here; a sent CAM is a step of its own."""
    return event.is_input or (isinstance(event, Send) and event.is_cam)
