"""One station, sans-IO: no socket, no clock, no thread.

Every entry point takes ``now`` (integer milliseconds, never decreasing) and returns the effects in
order: those of due timers first, then those of the input (docs/protocol.md, section 3).  The rules
decide (rules.py); this module manages the armed timers.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import NamedTuple

from automcm.core.outcome import Expiry, Input, Me, Outcome, Received, ReceivedCam, Restart, Rules
from automcm.core.rules import RULES, decide
from automcm.core.state import LEASE, State, Timer, armed
from automcm_spec.vocabulary.application import Accepted, Command, Discarded, Indication
from automcm_spec.vocabulary.messages import (
    Advertisement,
    Cam,
    Message,
    MessageError,
    Trajectory,
    decode,
)
from automcm_spec.vocabulary.parameters import (
    Known,
    Parameters,
    durations,
    forgotten_at,
    lease_lasts,
    rank,
)

Plan = Callable[[Advertisement], Trajectory | None]
"""The application's predicate "concerned" (ADV-3): its planned trajectory, or None."""
Decode = Callable[[bytes], Message | Cam]
"""A codec's decoder; raises MessageError."""


DEFAULT = Parameters()


@lru_cache
def _times(p: Parameters) -> tuple[Known, Mapping[str, int | None]]:
    """All parameters by name, and the durations of timers; shared by stations with equal ones."""
    return p.known, durations(p.known)


def unconcerned(advertisement: Advertisement) -> Trajectory | None:
    """A plan that joins no session."""
    return None


class Effects(NamedTuple):
    """The effects of one input at ``now_ms``.

    ``input`` is None for bytes that are not a valid message.  ``armed`` holds the timers that were
    armed or restarted, with their deadlines in ms; ``stopped`` those that were stopped before they
    expired.
    """

    now_ms: int
    input: Input | None
    rule: str
    state: State
    """The state after the input."""
    messages: tuple[Message, ...] = ()
    indications: tuple[Indication, ...] = ()
    armed: tuple[tuple[Timer, int], ...] = ()
    stopped: tuple[Timer, ...] = ()


class Station:
    """A station that can be a prescriber in one session and a receiver in another.

    ``number`` is the last session number that the station has used; it must survive a restart
    (END-8).  After a restart, call ``restart`` at once.  ``seed`` is the seed of the back-off
    (END-7).
    """

    def __init__(
        self,
        station_id: int,
        parameters: Parameters | None = None,
        *,
        plan: Plan = unconcerned,
        number: int = 0,
        seed: int = 0,
        rules: Rules | None = None,
        decode: Decode = decode,
    ) -> None:
        self.parameters = p = parameters or DEFAULT
        limits = p.max_rounds, p.max_participants, p.outbox_limit, p.memory_limit
        self.me = Me(station_id, *limits, p.t_resend, p.clock_drift)
        self.state = State(number=number)
        self.timers: dict[Timer, int] = {}
        """The deadline of each armed timer in ms, the oldest timer first."""
        self.durations: Mapping[str, int] = {}
        """Durations in ms, by timer name, that replace those of the parameters.  They apply from
        the next arming on.  For the conformance kit."""
        self._times = _times(p)
        self._plan = plan
        self._rules = RULES if rules is None else rules
        self._decode = decode
        self._random = random.Random(seed)
        self._joined_at: dict[int, int] = {}
        self._now = 0

    @property
    def station_id(self) -> int:
        """The station's own id."""
        return self.me.station_id

    def next_deadline(self) -> int | None:
        """The time in ms by which ``advance`` must be called; None if no timer runs."""
        return min(self.timers.values(), default=None)

    def advance(self, now: int) -> list[Effects]:
        """Fire the due timers.  Raises ValueError if time goes back."""
        if now < self._now:
            raise ValueError(f"now must not decrease: {now} ms after {self._now} ms")
        self._now = now
        effects: list[Effects] = []
        while self.timers and min(self.timers.values()) <= now:
            effects.append(self._step(Expiry(self._first()), now))
        return effects

    def receive(self, message: Message | Cam | bytes, now: int) -> list[Effects]:
        """Take a message, a CAM, or bytes from the radio.  Invalid bytes are discarded (END-5)."""
        effects = self.advance(now)
        if isinstance(message, bytes):
            try:
                message = self._decode(message)
            except MessageError as error:
                indication = Discarded(detail=str(error))
                effects.append(Effects(now, None, "END-5", self.state, indications=(indication,)))
                return effects
        i = ReceivedCam(message, now) if isinstance(message, Cam) else self._received(message)
        effects.append(self._step(i, now))
        return effects

    def command(self, command: Command, now: int) -> list[Effects]:
        """Take a command of the application.  It is refused if no rule allows it (CMD-1)."""
        return [*self.advance(now), self._step(command, now)]

    def restart(self, now: int) -> list[Effects]:
        """Restart without memory of a session (END-8).  Timers that are due do not fire."""
        if now < self._now:
            raise ValueError(f"now must not decrease: {now} ms after {self._now} ms")
        self._now = now
        return [self._step(Restart(), now)]

    def _received(self, message: Message) -> Received[Message]:
        plan = None
        if isinstance(message, Advertisement) and message.src != self.station_id:
            plan = self._plan(message)
        return Received(message, plan)

    def _first(self) -> Timer:
        """The timer that fires next: by deadline, then rank, then age of its message."""

        def turn(timer: Timer) -> tuple[int, int]:
            advertises = timer.entry is not None and timer.entry.type == "Advertisement"
            return self.timers[timer], rank(timer.name, advertises)

        return min(armed(self.station_id, self.state), key=turn)

    def _step(self, i: Input, now: int) -> Effects:
        before = self.state
        rule, outcome = decide(self.me, before, i, self._rules)
        self.state, messages, indication, again = outcome
        newly: tuple[tuple[Timer, int], ...] = ()
        stopped: tuple[Timer, ...] = ()
        if self.state is not before or again or isinstance(i, Expiry):
            newly, stopped = self._rearm(before, outcome, i, now)
        if isinstance(indication, Accepted):  # the rules have no clock
            left = self.timers[LEASE] - now
            indication = indication.model_copy(update={"lease_left_ms": left})
        indications = () if indication is None else (indication,)
        return Effects(now, i, rule, self.state, messages, indications, newly, stopped)

    def _rearm(
        self, before: State, outcome: Outcome, i: Input, now: int
    ) -> tuple[tuple[tuple[Timer, int], ...], tuple[Timer, ...]]:
        """Arm and stop timers so that exactly those of the new state run."""
        expired = i.timer if isinstance(i, Expiry) else None
        if expired is not None:
            self.timers.pop(expired, None)
        if outcome.state.joined is not before.joined:
            self._joined_at = {
                p: self._joined_at.get(p, now) if before.joined.get(p) == number else now
                for p, number in outcome.state.joined.items()
            }
        timers = self.timers
        running = armed(self.station_id, outcome.state)
        stopped = [timer for timer in timers if timer not in running]
        for timer in stopped:
            del timers[timer]
        for timer in outcome.again:
            timers.pop(timer, None)
        newly = []
        for timer in running:
            if timer not in timers:
                timers[timer] = deadline = now + self._duration(timer, now)
                newly.append((timer, deadline))
        return tuple(newly), tuple(stopped)

    def _duration(self, timer: Timer, now: int) -> int:
        p, name = self.parameters, timer.name
        if name == "lease":
            return lease_lasts(p.clock_drift, self.state.role, self.state.lease_ms)
        if name in self.durations:
            return self.durations[name]
        if name == "backoff":
            return self._random.randint(p.backoff_min, p.backoff_max)
        known, lasting = self._times
        if name == "forget":
            return forgotten_at(known, self._joined_at.get(timer.station, now), now) - now
        lasts = lasting[name]
        assert lasts is not None, f"no formula: {name}"
        return lasts
