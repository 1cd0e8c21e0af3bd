"""Checks a station's log against the compiled specification, event by event.

The specification computes the effects of each input (a message, a command, an expiry). They are
compared with the logged effects. Events of a kind that the log does not promise may be absent.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any, NamedTuple, Self

from automcm_spec.log_format.log import (
    ApplicationCommand,
    ApplicationIndication,
    CamFields,
    Event,
    ForgetTimer,
    Header,
    MessageTimer,
    PlainTimer,
    Receive,
    Restart,
    Send,
    Timer,
    TimerArm,
    TimerEnd,
    typed,
)
from automcm_spec.vocabulary import station as spec
from automcm_spec.vocabulary.messages import Fields, Prescription
from automcm_spec.vocabulary.parameters import durations, lease_lasts, rank
from automcm_spec.vocabulary.rules import RULES
from automcm_spec.vocabulary.station import Entry, Expire, Input, Outcome, State, Station
from automcm_traces.checker.compared import wrongly_told
from automcm_traces.checker.finding import Diverges, Late, Seen
from automcm_traces.checker.track import (
    NO_INDICATION,
    RESTARTED,
    UNBOUND,
    CannotTell,
    InputStep,
    Quarantine,
    SpecInput,
    Track,
    armed_name,
    commanded,
    limits_of,
    short,
    timer_name,
)

NOTHING = "no further effect"
"""The expected effect of a step whose effects have all been observed."""
REMEMBERED = 4_000
"""The maximum number of answers of the specification kept in memory."""
CAMS = 1000
"""The maximum number of cached steps for CAMs."""
LEASE = PlainTimer(name="lease")


@cache
def specification(*limits: int) -> Callable[[int, State, Input], tuple[Outcome, bool]]:
    """A function that computes ``Step`` of Station.tla with these limits, and whether the state
    stays the same. It remembers its last answers, for all logs."""
    station = Station(*limits)

    @lru_cache(maxsize=REMEMBERED)
    def answer(me: int, st: State, i: Input) -> tuple[Outcome, bool]:
        outcome = station.step(me, st, i)
        return outcome, outcome.st == st

    return answer


class NoInput(NamedTuple):
    """A malformed or rejected message, no input: it causes only ``discarded`` (END-5)."""

    line: int
    must_report: bool
    """Whether the station must report it."""
    why: str
    reported: bool = False


class Deadline(NamedTuple):
    """When an armed timer expires, in ms of the station's clock: not before ``first``, at the
    latest at ``last``, which is None if unknown."""

    first: int
    last: int | None
    armed: str = ""
    """By which line it was armed, and for how long, as text."""


class Engine:
    """Checks one station's log. A timer may expire up to ``late_ms`` after its deadline, by default
    half of t_resend, the longest delay of a copy (docs/protocol.md, section 3)."""

    def __init__(self, header: Header, late_ms: int | None = None) -> None:
        p = header.known
        self._durations = durations(p)
        self._clock_drift = p.get("clock_drift", 0)
        self.promised = frozenset(header.complete)
        self._late_ms = header.longest_delay if late_ms is None else late_ms
        resend = header.t_resend, self._clock_drift
        self.track = Track(header.station, limits_of(p), *resend)
        self._answer = specification(*self.track.limits)
        self._shares_track = False
        """Whether a copy may have the same track; it is copied before it changes."""
        self.timers: dict[Timer, Deadline] = {}
        self.since_ms = 0
        """The time of the last event other than a CAM; unobserved inputs happened later."""
        self.observer: Callable[[InputStep, Track], None] | None = None
        """Called after each complete step, with the station after it."""
        self.step: InputStep | None = None
        """The last input and the effects still expected; None after ``finish``."""
        self.malformed: NoInput | None = None
        """The last input, if it was a malformed message."""
        self._cams: dict[tuple[int, bool, bool], InputStep] = {}
        """Steps for CAMs in the current state, which leave it as it is: by sender, whether they
        mark the session, and whether they are newer."""

    def copy(self) -> Self:
        """A copy that can continue independently."""
        other = self.__class__.__new__(self.__class__)
        self._shares_track = True
        other.__dict__.update(self.__dict__)
        other.timers = dict(self.timers)
        other._cams = {}
        other.step = None if self.step is None else self.step.copy()
        return other

    # -- the expected effects, for callers that drive a station while they write its log

    def takes(self, fields: Fields) -> bool:
        """Whether the current step expects this message to be sent."""
        step, m = self.step, typed(fields)
        if step is None or isinstance(m, list | CamFields):
            return False
        new = step.content, step.fresh
        return any(e.difference(m, self.track, *new) is None for e in step.messages)

    def timers_to_change(self) -> tuple[list[Timer], list[tuple[Timer, int | None]]]:
        """The timers that the current step still stops, and those that it arms, each with its
        duration in ms: None for backoff and forget, and if the header lacks the parameter.

        They are named as in a log, so the messages of the step must have been fed before.
        """
        step = self.step
        if step is None:
            return [], []
        armed = [self.track.named(step.sent, timer) for timer in step.arm]
        armed.sort(key=lambda timer: getattr(getattr(timer, "message", None), "seq", 0))  # as sent
        stopped = [self.track.named(step.sent, timer) for timer in step.stop]
        return stopped, [(timer, self._duration(step, timer)) for timer in armed]

    def outstanding(self) -> list[str]:
        """The missing effects of the last input, of the kinds that the log promises."""
        step = self.step
        if step is None:
            return []
        missing = [f"send {m}" for m in step.messages] if "send" in self.promised else []
        if "timer" in self.promised:
            for t in step.arm:
                ms = self._durations.get(t[0])
                missing.append(f"arm {short(t)}{'' if ms is None else f' for {ms} ms'}")
            missing += [f"stop {short(t)}" for t in step.stop]
        missing += [f"indication {t}" for t in step.indications if "indication" in self.promised]
        return missing

    # -- events

    def feed(self, at: int, event: Event) -> None:
        """Check the next event. Raises Diverges, CannotTell."""
        match event:
            case Receive() | ApplicationCommand() | TimerEnd(op="expire"):
                self.finish()
                self._missed(at, event.t_ms, event)
                self._input(at, event)
            case Send(message=message) if message["type"] == "CAM":
                self.finish()
                self._missed(at, event.t_ms)
                self._cam_sent(at, message)
                self._phase_is(at, event)
                return
            case Send(message=message):
                self._sent(at, event.t_ms, message)
            case TimerArm() | TimerEnd():
                self._timer_changed(at, event)
            case ApplicationIndication():
                self._indicated(at, event)
            case Restart():  # timers that were due before are lost (END-8)
                self.finish()
                self._input(at, event)
        if not event.is_cam:
            self.since_ms = event.t_ms
        if event.phase is not None or event.role is not None:
            self._phase_is(at, event)

    def finish(self) -> None:
        """End the last step. Raises Diverges if expected effects are missing."""
        step, malformed = self.step, self.malformed
        self.malformed = None
        if malformed is not None and malformed.must_report and "indication" in self.promised:
            text = "receive a malformed message: effects are missing"
            raise Diverges(malformed.line, text, "END-5", ["indication discarded"], _by("END-5"))
        if step is None:
            return
        left = step.messages or step.arm or step.stop or step.indications
        missing = self.outstanding() if left else []
        if missing:
            text = f"{step.what}: effects are missing"
            raise Diverges(step.at, text, step.rule, missing, step.guard, step)
        if step.messages:  # allowed to be missing, but then its seq is unknown
            raise CannotTell(f"line {step.at}: the log does not contain: send {step.messages[0]}")
        if "timer" not in self.promised:
            self._assume_timers(step)
        self.step = None
        if step.moves:
            self._lift(step)
        if self.observer is not None:
            self.observer(step, self.track)

    def _lift(self, step: InputStep) -> None:
        if self._shares_track:
            self.track, self._shares_track = self.track.copy(), False
        t, m = self.track, step.given
        if step.input[0] == "restart":
            self.timers = {k: d for k, d in self.timers.items() if k.name == "quarantine"}
        after = step.after
        restarts = step.input.kind == "restart"
        if after.quarantine and (restarts or not t.state.quarantine):
            rule, ms = "END-8" if restarts else "ACT-6", self._durations["quarantine"]
            t.quarantine = Quarantine(step.at, rule, ms)
        if after is not t.state or step.sent:
            self._cams.clear()
            was = t.state.phase
            t.advance(after, step.sent)
            prescribed = step.input.kind == "receive" and step.input.message.type == "Prescription"
            if prescribed and t.state.phase == "NEGOTIATING" != was:
                t.lease_ms = m.lease_ms if isinstance(m, Prescription) else 0
        if step.input.kind == "cam" and step.changes:
            t.last_cam_ms = m["generation_ms"] if isinstance(m, CamFields) else t.last_cam_ms or 0
            t.last_cam_line = step.at
            if isinstance(m, CamFields) and t.first_cam_ms is None:
                t.first_cam_ms = m["generation_ms"], step.t_ms

    def _phase_is(self, at: int, event: Event) -> None:
        """Check the phase and the role after the step, where the log states them."""
        step = self.step
        state = self.track.state if step is None else step.after
        if event.phase == state.phase and event.role == state.role:
            return
        pairs = ("phase", event.phase, state.phase), ("role", event.role, state.role)
        for name, is_, should in pairs:
            if is_ is not None and is_ != should:
                rule, guard = self._last_rule()
                wants = [f"{name} {should}"]
                text = f"{name} {is_}{'' if step else self._malformed_note()}"
                raise Diverges(at, text, rule, wants, guard, step, (name, is_))

    # -- inputs

    def _input(self, at: int, event: Event) -> None:
        match event:
            case Receive(message=dict() as fields):  # faster than dict(fields)
                m = typed(fields)
                if isinstance(m, list):  # END-5: the only effect is "discarded"
                    mine = fields.get("dst", self.track.me) == self.track.me
                    self.malformed = NoInput(at, mine, f"malformed ({': '.join(m[0])})")
                elif isinstance(m, CamFields):
                    self._cam_received(at, event, m)
                else:
                    self._begin_step(at, event.t_ms, event, self.track.received(event, m))
            case Receive(rejected=reason):
                why = f"rejected ({reason})" if reason else "malformed (raw bytes)"
                self.malformed = NoInput(at, False, why)
            case TimerEnd(timer=timer):
                self._expired(at, event, timer)
            case ApplicationCommand(command=command):
                self._begin_step(at, event.t_ms, event, commanded(command))
            case _:
                self._begin_step(at, event.t_ms, event, RESTARTED)

    def _cam_received(self, at: int, event: Receive, m: CamFields) -> None:
        """A received CAM. Most change no more than a timer: the step of an equal CAM is reused."""
        t, t_ms = self.track, event.t_ms
        alike = m["src"], [*t.state.session] in m["marks"], t.is_newer(m, t_ms)
        known = self._cams.get(alike)
        if known is None:
            step = self._begin_step(at, t_ms, event, t.cam_received(m, *alike))
            if step.after is t.state and not step.messages and len(self._cams) < CAMS:
                self._cams[alike] = step.copy()
            return
        self.step = step = known.copy() if known.changes else known
        step.at, step.t_ms, step.event, step.given, step.since_ms = at, t_ms, event, m, t_ms

    def _expired(self, at: int, event: Event, timer: Timer) -> None:
        what, rule = f"expire {timer_name(timer)}", self._rule_of(timer)
        deadline = self.timers.pop(timer, None)
        seen = ("expire", timer)
        if deadline is None:
            armed = ", ".join(sorted(map(armed_name, self.timers)))
            wanted = [f"an armed timer: {armed or 'none is armed'}"]
            raise Diverges(at, f"{what}: not armed", rule, wanted, "", None, seen)
        if event.t_ms < deadline.first:
            ms = deadline.first - event.t_ms
            early, wanted = f"{what}: {ms} ms too early", [f"{what} {ms} ms later"]
            raise Diverges(at, early, rule, wanted, _by(rule), None, seen)
        question = self.track.expired(timer)
        if question is None:
            gone = f"{what}: no such message in the outbox"
            raise Diverges(at, gone, "END-6", [], "", None, seen)
        self._begin_step(at, event.t_ms, event, question)

    def _begin_step(
        self, at: int, t_ms: int, event: Event | None, question: SpecInput
    ) -> InputStep:
        """Begin the step of an input: work out its expected effects."""
        t, value, given = self.track, question.value, question.given
        found, stays = self._answer(t.me, t.state, value)
        step = self.step = InputStep(
            at,
            t_ms,
            event,
            value,
            question.what,
            found.rule,
            t.state if stays else found.st,
            bool(not stays or found.arm or found.stop),
            found.told,
            [t.expected(m, value, given) for m in sorted(found.out)],
            sorted(found.arm),
            # A restart stops every timer, logged or not.
            sorted(found.stop) if value.kind != "restart" else [],
            [] if found.told == NO_INDICATION else [found.told[0]],
            given,
            question.content,
            t_ms,
        )
        return step

    # -- effects

    def _current(self, at: int, t_ms: int, seen: Seen) -> InputStep:
        """The step of an effect. The first effect bounds the time of an unobserved input."""
        step = self.step
        if step is None:
            text = f"{_said(seen)}: no input calls for it{self._malformed_note()}"
            rule, guard = self._last_rule()
            raise Diverges(at, text, rule, [], guard, None, seen)
        if step.unseen:
            first = max(step.since_ms, t_ms - max(self._late_ms - 1, 0))
            if first > step.t_ms:
                self._missed(at, first)
                wanted = [f"{step.what}, at least {first - step.t_ms} ms earlier"]
                raise Late(at, _said(seen), step.rule, wanted, step.guard, step, seen)
            step.unseen, step.since_ms = False, first
        return step

    def _malformed_note(self) -> str:
        """A note that the last message has no effect, and why; empty if it has."""
        if self.malformed is None:
            return ""
        return f"; the message of line {self.malformed.line} is {self.malformed.why}"

    def _last_rule(self) -> tuple[str, str]:
        """The rule that decided the last input, and its guard text; both empty if there is none."""
        if self.step is not None:
            return self.step.rule, self.step.guard
        return ("END-5", _by("END-5")) if self.malformed is not None else ("", "")

    def _sent(self, at: int, t_ms: int, fields: Fields) -> None:
        seen = "send", fields
        step, m = self._current(at, t_ms, seen), typed(fields)
        assert not isinstance(m, CamFields), "feed passes CAMs to _cam_sent"
        problems: list[tuple[int, str]] = []
        for e in step.messages:
            problem: str | None
            if isinstance(m, list):
                problem = ": ".join(m[0])
            elif (problem := e.difference(m, self.track, step.content, step.fresh)) is None:
                step.messages.remove(e)
                step.sent.append((e, m))
                step.fresh += e.is_new
                return
            if e.value.type == fields["type"]:
                problems.append((e.mismatch(fields), problem))
        least, problem = min(problems, key=lambda p: p[0], default=(0, None))
        why = f" ({problem})" if problem else ""
        wanted = self.outstanding() or [NOTHING]
        raise Diverges(at, f"{_said(seen)}{why}", step.rule, wanted, step.guard, step, seen, least)

    def _cam_sent(self, at: int, fields: Fields) -> None:
        """Check a sent CAM (ACT-5): it marks the session and those whose Fin is still being
        sent."""
        m: Any = typed(fields)
        wanted, rule = self.track.marks, "ACT-5"
        wants: list[str] = []
        if isinstance(m, list):
            text, rule = f"send CAM ({': '.join(m[0])})", "END-5"
        elif m["src"] != self.track.me:
            text, wants = f"send CAM: src {m['src']}", [f"src {self.track.me}"]
        elif {*map(tuple, m["marks"])} != wanted:
            text = f"send CAM: marks {m['marks']}"
            own = self.track.session
            each = (
                f"{p}/{n} ({'its session' if (p, n) == own else 'its Fin is still sent'})"
                for p, n in sorted(wanted)
            )
            wants = [f"marks {', '.join(each) or 'none: it is in no session'}"]
        else:
            return
        raise Diverges(at, text, rule, wants, _by(rule), None, ("send", fields))

    def _indicated(self, at: int, event: ApplicationIndication) -> None:
        name, given = event.indication.name, event.indication.model_extra or {}
        m = self.malformed
        may_be_reported = (m and not m.reported) or "receive" not in self.promised
        by_form = given.get("rule", "END-5") == "END-5"
        if self.step is None and name == "discarded" and by_form and may_be_reported:
            self.malformed = m and m._replace(must_report=False, reported=True)
            return
        seen = ("indication", name)
        step = self._current(at, event.t_ms, seen)
        text, wanted, mismatch = _said(seen), self.outstanding() or step.indications, 0
        if name in step.indications:
            lease = self.timers.get(LEASE)
            left = lease.first if lease and lease.first == lease.last else None
            wrong = wrongly_told(name, given, step, self.track.state, left)
            if not wrong:
                step.indications.remove(name)
                return
            mismatch = 1 + len(wrong)
            one, (should, is_) = next(iter(wrong.items()))
            text += f" ({one}: expected {should}, got {is_})"
        raise Diverges(at, text, step.rule, wanted or [NOTHING], step.guard, step, seen, mismatch)

    def _timer_changed(self, at: int, event: TimerArm | TimerEnd) -> None:
        timer, seen = event.timer, (event.op, event.timer)
        step = self._current(at, event.t_ms, seen)
        armed = isinstance(event, TimerArm)
        pool = step.arm if armed else step.stop
        if step.input[0] == "restart" and not armed and timer in self.timers:
            del self.timers[timer]
            return
        for value in pool:  # without a message or station, it is equal by name
            named = value[0] == timer.name
            if named and (len(value) == 1 or self.track.named(step.sent, value) == timer):
                pool.remove(value)
                break
        else:
            wanted = self.outstanding() or [NOTHING]
            raise Diverges(at, _said(seen), step.rule, wanted, step.guard, step, seen)
        if not isinstance(event, TimerArm):
            self.timers.pop(timer, None)
            return
        duration = self._duration(step, timer)
        if duration is not None and event.deadline != event.t_ms + duration:
            wanted = [f"{_said(seen)} for {duration} ms"]
            text = f"{_said(seen)} for {event.deadline - event.t_ms} ms"
            guard = step.guard
            if timer.name == "lease":
                guard = _by("ACT-4")
                if (lease := self._lease_of(step)) is not None and lease != duration:
                    wanted[0] += f": {lease} less {self._clock_drift} % and 1 ms"
            raise Diverges(at, text, step.rule, wanted, guard, step, ("deadline", timer))
        self._arm(timer, event.deadline, event.deadline, at, event.t_ms)

    def _arm(self, timer: Timer, first: int, last: int | None, at: int, t_ms: int) -> None:
        """Record a deadline; unobserved CAMs may postpone that of the timer cam (ACT-5)."""
        if timer.name == "cam" and not {"receive", "timer"} & self.promised:
            last = None
        armed = "" if last is None else f"due {last - t_ms} ms after line {at}"
        self.timers[timer] = Deadline(first, last, armed)

    def _assume_timers(self, step: InputStep) -> None:
        """Stop and arm the timers of the step, in a log that does not promise timer events."""
        stop, arm = self.timers_to_change()
        for timer in stop:
            self.timers.pop(timer, None)
        for timer, duration in arm:
            last = None if duration is None else step.t_ms + duration
            self._arm(timer, step.since_ms + (duration or 0), last, step.at, step.t_ms)
        step.stop, step.arm = [], []

    def _duration(self, step: InputStep, timer: Timer) -> int | None:
        if timer.name != "lease":
            return self._durations.get(timer.name)
        if (lease_ms := self._lease_of(step)) is not None:
            return lease_lasts(self._clock_drift, "prescriber", lease_ms)
        return self.track.lease_ms or None

    def _lease_of(self, step: InputStep) -> int | None:
        """The lease of the Prescription that the station sent in this step."""
        sent = (m.lease_ms for _, m in step.sent if isinstance(m, Prescription))
        return next(sent, None)

    def _missed(self, at: int, t_ms: int, event: Event | None = None) -> None:
        """Raise Late if a timer should have expired more than late_ms before ``t_ms``.

        If timers are complete, also if a due timer should have expired before this event: before a
        message or command of its instant, or before a timer that comes later (docs/protocol.md,
        section 3, items 5 and 6).
        """
        last: dict[Timer, int] = {}
        for timer, deadline in self.timers.items():
            if deadline.last is not None and deadline.last <= t_ms:
                last[timer] = deadline.last
        if not last:
            return

        def turn(timer: Timer) -> tuple[int, int, int]:
            """Due timers expire in ascending order of deadline, rank and age of the message."""
            key = timer.message if isinstance(timer, MessageTimer) else None
            entry = key and self.track.entry_of(key, key.to or 0, key.session)
            place = rank(timer.name, key is not None and key.type == "Advertisement")
            return last[timer], place, self.track.outbox.index(entry) if entry else 0

        first = min(last, key=turn)
        name, rule, ms = armed_name(first), self._rule_of(first), t_ms - last[first]
        match event:
            case _ if ms > self._late_ms:
                raise self._late(at, f"{name} was due at least {ms} ms before", first, rule)
            case _ if "timer" not in self.promised:
                return
            case TimerEnd(timer=own) if own in last and turn(own) > turn(first):
                text = f"expire {armed_name(own)}: {name}, due {ms} ms before, must expire first"
            case ApplicationCommand() | Receive() if t_ms in last.values() and _is_taken(event):
                text = f"{name}, due {ms} ms before, must expire first"
            case _:
                return
        raise Late(at, text, rule, [f"expire {name} before"], _by(rule))

    def _late(self, at: int, text: str, timer: Timer, rule: str) -> Late:
        """``text``, with when the timer was due, and how late it may be."""
        armed = self.timers[timer].armed
        text += f"; {armed}" if armed else ""
        tolerated = f"at most {self._late_ms} ms late (--late)"
        late = Late(at, text, rule, [f"expire {armed_name(timer)} before, {tolerated}"], _by(rule))
        key = timer.message if isinstance(timer, MessageTimer) else None
        late.message = key.type if key and timer.name == "resend" else ""
        return late

    def _rule_of(self, timer: Timer) -> str:
        """The rule by which the specification decides the expiry of a timer, armed or not."""
        t = self.track
        value: spec.Timer = (timer.name,)
        if isinstance(timer, MessageTimer):  # only the type of the message matters
            type_ = timer.message.type if timer.message else "none"
            value = timer.name, Entry(type_, 0, UNBOUND, 0, False)
        elif isinstance(timer, ForgetTimer):
            value = timer.name, timer.station or 0
        return self._answer(t.me, t.state, Expire("expire", value))[0].rule


def _said(seen: tuple[str, Any]) -> str:
    """An effect in the log, as text."""
    what, about = seen
    if what == "send":
        return f"send {about['type']} to {about.get('dst', 'all')}"
    return f"{what} {about if what == 'indication' else timer_name(about)}"


def _is_taken(event: Event) -> bool:
    """Whether an event is a command or a well-formed message (END-5)."""
    m = event.message if isinstance(event, Receive) else None
    return isinstance(event, ApplicationCommand) or bool(m and not isinstance(typed(m), list))


def _by(rule: str) -> str:
    return f"{rule}: {RULES[rule]}"
