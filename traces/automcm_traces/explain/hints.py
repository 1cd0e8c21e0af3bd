"""Hints that the log, and not the station, is to blame for a divergence; and the datagrams that the
secured link of a station discarded: how many, why, and what this hints at.

A hint is a question to whoever wrote the log. It is no verdict, and changes none.
"""

from __future__ import annotations

import copy
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any, Final, Literal

from automcm_spec.log_format.log import (
    CamFields,
    Event,
    Header,
    MessageTimer,
    PlainTimer,
    Receive,
    Restart,
    Send,
    TimerArm,
    TimerEnd,
    source_of,
    transmission,
    typed,
)
from automcm_spec.log_format.number_sets import Numbers
from automcm_spec.vocabulary.messages import session_in
from automcm_spec.vocabulary.station import Station
from automcm_traces.checker.engine import Engine
from automcm_traces.checker.finding import Diverges, Seen
from automcm_traces.checker.follow import Check, Follower, Watcher
from automcm_traces.checker.log_start import OPENING, opens, shows_standalone
from automcm_traces.checker.track import CannotTell, Track
from automcm_traces.system.fates import ANYONE

KEPT: Final = 20
"""The number of Advertisements remembered."""
CANDIDATES: Final = 20
"""The maximum number of late timers whose delay is tried as a step of the clock."""


class Hints(Watcher):
    """Watches the check of a log for what the hints are about."""

    def __init__(self, header: Header) -> None:
        self._header = header
        self._cam_received = False
        self._own_cams: deque[int] = deque(maxlen=4)
        """The times of the last four CAMs sent."""
        self._by_cams = range(0)
        """By how much the clock stepped if it stepped between two CAMs sent; empty: no step."""
        self._not_planned: dict[tuple[int, int], Receive] = {}
        """The last Advertisements without ``planned``, by session."""
        self._begun = False
        """Whether an event showed the station outside a session, or entering one."""
        self._sent = Numbers()
        self._again = ""
        """The first transmission with the id of an earlier one."""
        self._last_ms = -1
        self._gaps_ms = [0, 0]
        """The two longest times between two events, the longest last."""

    def event(self, line: int, event: Event, engine: Follower) -> None:
        """Take note of an event."""
        self._time(event.t_ms)
        if isinstance(event, Send):
            station, number = transmission(event.tx)
            own = station == self._header.station
            if own and not self._sent.add(number) and not self._again:
                again = "each transmission needs its own, also a copy"
                self._again = f"line {line} uses tx {event.tx} a second time: {again}"
            if event.is_cam:
                self._own_cam(event.t_ms)
        elif isinstance(event, Receive):
            if event.is_cam:
                self._cam_received = True
            elif event.planned is None and (its := _advertised(event)):
                kept = list(self._not_planned.items())[1 - KEPT :]
                self._not_planned = dict([*kept, (its, event)])
        if not self._begun:
            self._begun = opens(event) or isinstance(event, Restart) or shows_standalone(event)

    def _time(self, t_ms: int) -> None:
        gap = t_ms - self._last_ms
        if gap > self._gaps_ms[0]:
            self._gaps_ms = sorted((gap, self._gaps_ms[1])) if self._last_ms >= 0 else [0, 0]
        self._last_ms = t_ms

    def hint(self, check: Check) -> str:
        """The hints on what was found, as one text; empty if there are none."""
        return "; ".join(filter(None, (self._again, self._about(check))))

    def _about(self, check: Check) -> str:
        d, engine = check.diverges, check.engine
        if d is None or engine is None:
            return ""
        match d.seen:
            case ("send", {"src": int(src)}) if src != self._header.station and not self._own_cams:
                return f"is this the log of station {self._header.station}? {src} sent the message"
        if not self._begun and not check.judged_from and _in_a_session(d, engine.track):
            mark = 'its header needs "begins": "running"'
            return f"does the log begin in mid-session? Then {mark}"
        if planned := self._planned(d.seen, check.recent[-1][1], engine.track):
            return planned
        if _about_cams(d) and "receive" in self._header.complete and not self._cam_received:
            drop = "`complete` must not have receive"
            return f"the log has no received CAM: if it does not record CAMs, {drop}"
        if d.finding.kind == "overdue" and (step_ms := self._clock_step(check, engine)):
            return f"did the clock jump by {step_ms:,} ms?"
        return ""

    def _planned(self, seen: Seen | None, last: Event, track: Track) -> str:
        """About an Intention that the station would send if the Advertisement concerned it."""
        match seen:
            case ("send", {"type": "Intention", "session": [int(p), int(n)]}):
                event = self._not_planned.get((p, n))
            case ("phase" | "role", _) if isinstance(last, Receive) and last.planned is None:
                event = last if _advertised(last) else None
            case _:
                event = None
        m = None if event is None else typed(event.message or {})
        if event is None or m is None or isinstance(m, list | CamFields):
            return ""
        concerned = track.received(replace(event, planned={}), m).value
        outcome = Station(*track.limits).step(track.me, track.state, concerned)
        if not any(out.type == "Intention" for out in outcome.out):
            return ""
        where = f"the Advertisement of session {m.session[0]}/{m.session[1]}"
        return f"{where} has no `planned`: with it, it concerns the application (ADV-3)"

    def _clock_step(self, check: Check, engine: Follower) -> int:
        """By how much the clock must have stepped before the last event for the events from there
        on to be allowed; 0 if no step explains them, or if nothing else speaks for one."""
        at, event = check.recent[-1]
        if event.late_ms is not None:
            return 0
        self._time(event.t_ms)
        other_ms, silence_ms = self._gaps_ms
        after = [(at, event), *check.after]
        for _, later in after:
            if isinstance(later, Send) and later.is_cam:
                self._own_cam(later.t_ms)
        shifted, by_cams = _shifted_timers(engine, after), self._by_cams
        likeliest = by_cams[len(by_cams) // 2 :][:1]
        for step_ms in dict.fromkeys([*shifted[:CANDIDATES], *likeliest]):
            silent = step_ms in by_cams and silence_ms > 2 * other_ms
            likely = silent or shifted.count(step_ms) > 1
            if 0 < step_ms <= silence_ms and likely and _allowed(engine, after, step_ms):
                return int(step_ms)
        return 0

    def _own_cam(self, t_ms: int) -> None:
        """Look for a pause between two CAMs of the station, with regular intervals around it. After
        a stop of the station the next interval is another."""
        times = self._own_cams
        times.append(t_ms)
        if len(times) == 4 and times[2] - times[1] > 2 * (times[1] - times[0]):
            before, pause, then = (b - a for a, b in pairwise(times))
            margin = before // 4
            if abs(then - before) <= margin:
                step_ms = pause - before
                self._by_cams = range(step_ms - margin, step_ms + margin + 1)


def _advertised(event: Receive) -> tuple[int, int] | None:
    """The session of a received Advertisement."""
    m = event.message or {}
    return session_in(m.get("session")) if m.get("type") == "Advertisement" else None


def _in_a_session(d: Diverges, track: Track) -> bool:
    """Whether a station in no session does what belongs to one."""
    if track.session is not None:
        return False
    match d.seen:
        case ("send", {"type": "CAM"}):
            return True
        case ("send", {**message}):
            return message["type"] not in OPENING
        case (_, PlainTimer(name="quarantine" | "backoff")):
            return False
        case (_, MessageTimer() | PlainTimer()) | ("phase" | "role" | "indication", _):
            return True
    i = None if d.step is None else d.step.input
    return i is not None and i.kind == "receive" and i.message.type != "Advertisement"


def _about_cams(d: Diverges) -> bool:
    """Whether a CAM would explain what was found: the timer cam is overdue, or armed again."""
    if d.finding.kind == "overdue":
        return d.finding.rule == "ACT-2"
    return d.seen == ("arm", PlainTimer(name="cam"))


def _shifted_timers(engine: Follower, after: Iterable[tuple[int, Event]]) -> list[int]:
    """For each timer that was armed before, how late it expires."""
    if not isinstance(engine, Engine):
        return []
    open_ = {timer: d.first for timer, d in engine.timers.items() if d.first == d.last}
    found = []
    for _, event in after:
        match event:
            case TimerArm(timer=timer) | TimerEnd(op="stop", timer=timer):
                open_.pop(timer, None)
            case TimerEnd(timer=timer) if timer in open_:
                found.append(event.t_ms - open_.pop(timer))
    return found


def _allowed(engine: Follower, after: Iterable[tuple[int, Event]], step_ms: int) -> bool:
    """Whether these events are allowed if the clock is put back by ``step_ms``."""
    trial = engine.copy() if isinstance(engine, Engine) else copy.copy(engine)
    if isinstance(trial, Engine):
        trial.observer = None
    try:
        for at, event in after:
            earlier: dict[str, Any] = {"t_ms": event.t_ms - step_ms}
            if isinstance(event, TimerArm):
                earlier["deadline"] = event.deadline - step_ms
            trial.feed(at, replace(event, **earlier))
    except Diverges:
        return False
    except CannotTell:
        pass
    return True


# -- the datagrams that the secured link discarded

Cause = Literal["forged", "replayed", "stale", "untrusted", "malformed", "other"]
"""``untrusted``: the signer's certificate is missing or not valid."""
CAUSES: Final[Mapping[str, tuple[Cause, str]]] = {
    "bad_signature": ("forged", "do they sign with the key of their certificate?"),
    "wrong_source": ("forged", "do they send under an id of their certificate?"),
    "not_permitted": ("forged", "does their certificate permit their role?"),
    "replayed": ("replayed", ""),
    "stale": ("stale", "do the clocks agree?"),
    "early": ("stale", "do the clocks agree?"),
    "unknown_authority": ("untrusted", "does this station know their authority?"),
    "certificate_expired": ("untrusted", "was their certificate renewed, and is the clock right?"),
    "certificate_not_yet": ("untrusted", "is the clock right?"),
    "revoked": ("untrusted", "should their certificate be revoked?"),
    "unknown_signer": ("untrusted", "do they send their certificate?"),
    "too_long": ("malformed", "do they sign their messages, with the same codec?"),
    "malformed": ("malformed", "do they sign their messages, with the same codec?"),
    "over_budget": ("other", ""),
}
"""By reason (docs/secured.md), with a question that hints at why it comes about. Of the reasons of
one cause, the first one explains the others: a signer is unknown because its certificate was not
accepted. Other reasons keep their names and mean ``other``."""
LEAST: Final = 3
"""The minimum number of rejected messages of a station for a hint."""
MOST: Final = 100
"""The maximum number of senders and of reasons kept; further ones count as ANYONE and ``other``."""


def cause_of(reason: str) -> Cause:
    """What a logged reason means."""
    return CAUSES[reason][0] if reason in CAUSES else "other"


class Rejections(Watcher):
    """Counts what a station rejected."""

    def __init__(self) -> None:
        self.reasons: Counter[str] = Counter()
        """All rejected datagrams."""
        self._from: dict[int, Counter[str]] = defaultdict(Counter)
        """The same, by the sender that ``tx`` names."""
        self._accepted: set[int] = set()
        """The stations of which a message was accepted."""

    def event(self, line: int, event: Event, engine: Follower) -> None:
        """Count a rejected datagram."""
        if not isinstance(event, Receive):
            return
        if event.rejected is None:
            if (source := source_of(event.message)) != ANYONE:
                self._accepted.add(source)
            return
        reason = event.rejected
        if reason not in self.reasons and len(self.reasons) >= MOST:
            reason = "other"
        sender = source_of(None, event.tx)
        if sender not in self._from and len(self._from) >= MOST:
            sender = ANYONE
        self.reasons[reason] += 1
        self._from[sender][reason] += 1

    def hints(self) -> Iterator[str]:
        """Why nobody answered, where one cause explains it: all messages of a station were rejected
        for it."""
        for sender, reasons in sorted(self._from.items()):
            heard = sender in self._accepted or (sender == ANYONE and self._accepted)
            if heard or reasons.total() < LEAST or len(set(map(cause_of, reasons))) > 1:
                continue
            if question := next((CAUSES[r][1] for r in CAUSES if r in reasons), ""):
                whose = f" that name station {sender} as sender" if sender else ""
                all_ = f"all {reasons.total()} messages{whose} were rejected"
                yield f"{all_} ({counted(reasons)}): {question}"


def ordered(reasons: Mapping[str, int]) -> dict[str, int]:
    """The most frequent reason first."""
    return dict(sorted(reasons.items(), key=lambda item: (-item[1], item[0])))


def counted(reasons: Mapping[str, int]) -> str:
    """Such as ``7 replayed, 5 bad_signature``."""
    return ", ".join(f"{n} {reason}" for reason, n in ordered(reasons).items())
