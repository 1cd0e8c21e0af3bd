"""Follows a station's log on the oracle, event by event.

An input (a message, a command, an expiry) asks the oracle what must follow; what the log says
followed is held against that.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from automcm_spec.generate import ONE_PEER, TWO_PEERS, spec_hash
from automcm_spec.oracle import Answer, Oracle, load
from automcm_spec.rules import RULES, handler, line
from automcm_traces.log import (
    ApplicationCommand,
    ApplicationIndication,
    Event,
    Receive,
    Restart,
    Send,
    TimerArm,
    TimerEnd,
)
from automcm_traces.reader import Log
from automcm_traces.track import (
    ME,
    NOBODY,
    ROUNDS,
    STRANGER,
    CannotTell,
    Expected,
    Track,
    View,
    Y,
    difference,
    expected,
    lift,
    number_of,
    others,
)

Json = Any
NEEDED = ("command", "receive", "restart", "send", "timer")
"""Kinds of event a log must promise to be complete in; with less, this engine cannot tell."""


class Diverges(Exception):
    """The log leaves the specification here."""

    def __init__(self, at: int, event: str, rule: str, wanted: Sequence[str], guard: str) -> None:
        super().__init__(event)
        self.at, self.event, self.rule, self.wanted, self.guard = at, event, rule, wanted, guard


@cache
def _oracle(two: bool) -> Oracle:
    graph = TWO_PEERS if two else ONE_PEER
    return load(graph.path, spec_hash())


@dataclass(slots=True)
class Step:
    """One input and what is still expected to follow it."""

    at: int
    t_ms: int
    input: Json
    what: str
    view: View
    answer: Answer
    messages: list[Expected]
    arm: list[tuple[View, Json]]
    stop: list[tuple[View, Json]]
    told: list[str]
    given: dict[str, Json] | None = None
    content: dict[str, Json] = field(default_factory=dict)
    fresh: int = 0
    sent: list[tuple[Expected, dict[str, Json]]] = field(default_factory=list)

    @property
    def rule(self) -> str:
        return self.answer.effect.rule

    @property
    def guard(self) -> str:
        rule = self.rule
        where = line(rule, self.input)
        return f"{rule}: {RULES.get(rule, '')} ({handler(self.input)}, Station.tla:{where})"


class Engine:
    """Follows one station's log.

    A timer may expire up to ``late_ms`` after its deadline, by default half of t_resend: what
    section 3 allows a copy to be under way.
    """

    def __init__(self, log: Log, late_ms: int | None = None) -> None:
        header = log.header
        missing = [kind for kind in NEEDED if kind not in header.complete]
        if missing:
            raise CannotTell(f"the log does not promise to hold all of: {', '.join(missing)}")
        p = header.parameters
        self._durations = {
            "advertise": p.t_advertise,
            "resend": p.t_resend,
            "giveup": p.t_giveup,
            "decide": p.t_decide,
            "hold": p.t_hold,
            "answer": _sum(p.t_decide, p.t_giveup),
            "cam": p.t_cam_loss,
            "quarantine": _sum(p.t_advertise, p.t_life),
        }
        self._tells = "indication" in header.complete
        self._late_ms = (p.t_resend or 100) // 2 if late_ms is None else late_ms
        self.track = Track(header.station, p.max_rounds or 3)
        self.timers: dict[str, int] = {}
        self.observer: Callable[[Step, Track], None] | None = None
        """Called after each step is complete, with the station as it is then."""
        self._step: Step | None = None

    # -- what may follow, for who drives a station and writes its log meanwhile

    @property
    def step(self) -> Step | None:
        """The last input and what is still expected to follow it; None after ``finish``."""
        return self._step

    def takes(self, m: dict[str, Json]) -> bool:
        """Whether the current step calls for this message to be sent."""
        step = self._step
        return step is not None and any(
            difference(e, m, self.track, step.content, step.fresh) is None for e in step.messages
        )

    def timers_to_change(self) -> tuple[list[Json], list[tuple[Json, int | None]]]:
        """The timers that the current step still stops, and those that it arms, each with its
        duration in ms: None for backoff, forget, and what the header does not tell.

        They are named as in a log, so the messages of the step must have been fed before.
        """
        step = self._step
        if step is None:
            return [], []
        armed = [self._named(step, view, value) for view, value in step.arm]
        return (
            [self._named(step, view, value) for view, value in step.stop],
            [(timer, self._duration(step, timer)) for timer in armed],
        )

    def _named(self, step: Step, view: View, value: Json) -> dict[str, Json]:
        """A timer of the oracle as a log names it."""
        if value[0] == "forget":
            return {"name": value[0], "station": view.real_id(value[1])}
        if value[0] not in ("resend", "giveup"):
            return {"name": value[0]}
        type_, to = value[1][0], view.real_id(value[1][1])
        waiting = [e for e in self.track.outbox if e.to in view.ids and view.entry(e) == value[1]]
        messages = [e.message for e in waiting]
        messages += [m for e, m in step.sent if (e.type, e.dst) == (type_, to)]
        if type_ == "Advertisement" and self.track.advertisement is not None:
            messages.append(self.track.advertisement)
        m = messages[0]
        about: dict[str, Json] = {"type": type_, "to": to} if to else {"type": type_}
        return {"name": value[0], "message": about | {"session": m["session"], "seq": m["seq"]}}

    # -- events

    def feed(self, at: int, event: Event) -> None:
        """The next event.  Raises Diverges, CannotTell, or KeyError for a malformed message."""
        match event:
            case Send(message=message) if message["type"] == "CAM":
                self.finish()
                self._cam_sent(at, message)
            case Send(message=message):
                self._sent(at, message)
            case TimerArm() | TimerEnd(op="stop"):
                self._timer_changed(at, event)
            case ApplicationIndication():
                self._told(at, event)
            case Restart():  # what was due before is lost (END-8)
                self.finish()
                self._input(at, event)
            case _:
                self.finish()
                self._missed(at, event)
                self._input(at, event)

    def finish(self) -> None:
        """No more effects of the last input: what is still expected is missing."""
        step, self._step = self._step, None
        if step is None:
            return
        missing = [f"send {m}" for m in step.messages]
        missing += [f"arm {_name(t)}" for _, t in step.arm]
        missing += [f"stop {_name(t)}" for _, t in step.stop]
        missing += [f"indication {t}" for t in step.told] if self._tells else []
        if missing:
            raise Diverges(
                step.at, f"{step.what}: not everything followed", step.rule, missing, step.guard
            )
        self._lift(step)
        if self.observer is not None:
            self.observer(step, self.track)

    def _lift(self, step: Step) -> None:
        t, before = self.track, self.track.phase
        after = _oracle(len(step.view.ids) > 2).states[step.answer.next]
        if step.input[0] == "restart":
            t.outbox, t.joined, t.recorded = [], {}, []
        lift(t, step.view, after, step.sent)
        m = step.given
        if m is None:
            return
        if m.get("type") == "Prescription" and t.phase == "NEGOTIATING" and before != t.phase:
            t.proposal, t.lease_ms = m["proposal"], m["lease_ms"]
        if m.get("type") == "CAM" and step.answer.changes:
            t.heard_ms = m["generation_ms"]

    # -- inputs

    def _input(self, at: int, event: Event) -> None:
        match event:
            case Receive(message=None):
                self._step = None  # END-5: nothing may follow but "discarded"
            case Receive(message=message) if message is not None:
                self._received(at, event, message)
            case ApplicationCommand(command=command):
                self._command(at, event, {"name": command.name, **(command.model_extra or {})})
            case TimerEnd(timer=timer):
                self._expired(at, event, timer.model_dump(exclude_none=True))
            case Restart():
                view = View(self.track, next(iter(others(self.track, 0)), 0))
                self._start(at, event, view, ["restart"], "restart")
                assert self._step is not None
                self._step.stop.clear()  # everything stops, not only what is in view

    def _received(self, at: int, event: Receive, m: dict[str, Json]) -> None:
        t, src = self.track, m["src"]
        what = f"receive {m['type']} from {src}"
        if m["type"] == "CAM":
            y = NOBODY if src == t.me else src  # an echo is nobody's CAM (ACT-5)
            view = View(t, y, next(iter(others(t, y)), 0), t.session)
            marked = t.session is not None and list(t.session) in m["marks"]
            newer = t.heard_ms is None or m["generation_ms"] > t.heard_ms
            marks = [view.sessions(t.session)] if marked else []
            self._start(at, event, view, ["cam", Y, marks, newer], what, given=m)
            return
        y = 0 if src == t.me else src
        z = next(iter(others(t, y)), 0)
        view = View(t, y, z, m["session"], m.get("proposal", 0))
        content = {"planned": event.planned} if event.planned is not None else {}
        message = self._message(view, m)
        concerned = self._misdirected(m) or (
            m["type"] != "Ack"
            and not (m["type"] == "Advertisement" and not content and m["session"][0] == src)
        )
        value = ["receive", message, concerned]
        self._start(at, event, view, value, what, given=m, content=content)

    def _misdirected(self, m: dict[str, Json]) -> bool:
        """MSG-1, END-5: whatever it holds, where it comes from or goes to settles it."""
        me, dst, to_all = self.track.me, m.get("dst", 0), m["type"] == "Advertisement"
        return m["src"] == me or dst not in (0, me) or (dst == 0) != to_all

    def _message(self, view: View, m: dict[str, Json]) -> Json:
        """A received message in the oracle's ids; a broken one as its kind in the alphabet."""
        t, type_, dst = self.track, m["type"], m.get("dst", 0)
        src = ME if m["src"] == t.me else Y
        if dst not in (0, t.me):
            return _template(type_, Y, STRANGER, [Y if type_ == "Advertisement" else ME, 1])
        if self._misdirected(m):
            to = ME if dst else 0
            if src == ME and type_ != "Advertisement":
                to = ME
            own = type_ != "Advertisement" or src == ME
            return _template(type_, src, to, [ME if own else Y, 1])
        session = view.sessions(m["session"])
        k, proposal = number_of(m), m.get("proposal", 0)
        accepted, reason, of = m.get("accepted", False), m.get("reason", "none"), ["none", 0]
        if type_ in ("Prescription", "Acceptance"):
            other = session[0] != (Y if type_ == "Prescription" else ME)
            if other:
                return _template(type_, src, ME, session)
            proposal = view.proposals(proposal)
            k = proposal if k else 0
        if reason not in ("none", "busy", "unknown_session", "closed"):
            reason = "as_sent"
        if type_ == "Ack":
            of = self._acked(view, m)
        return [type_, src, dst and ME, session, k, proposal, accepted, reason, of]

    def _acked(self, view: View, m: dict[str, Json]) -> Json:
        """What an Ack names: an entry of the outbox, or something that matches nothing."""
        of = m["of"]
        entry = self.track.entry_by_seq(
            {"type": of["type"], "to": m["src"], "session": m["session"], "seq": of["seq"]}
        )
        if entry is None or not of["seq"]:
            return ["Cancel", 0]
        return [entry.type, view.entry(entry)[3]]

    def _command(self, at: int, event: Event, c: dict[str, Json]) -> None:
        t, name = self.track, c["name"]
        session, proposal, target = c.get("session"), c.get("proposal", 0), c.get("target", 0)
        if target == t.me:
            target = NOBODY  # whom it has not recorded (PRE-2)
        y = target or t.peer
        view = View(t, y, next(iter(others(t, y)), 0), session, proposal)
        real = view.sessions(session) if name != "request" else [0, 0]
        k = view.proposals(proposal)
        if k > ROUNDS:  # a wrong one, then; the oracle knows commands up to 3 (PRE-5)
            current = view.proposals(t.proposal)
            k = current or 2 if name == "prescribe" else current % ROUNDS + 1
        value = ["command", name, real, k, view.ids.get(target, 0)]
        self._start(at, event, view, value, f"command {name}", given=c, content=c)

    def _expired(self, at: int, event: Event, timer: dict[str, Json]) -> None:
        t, name, what = self.track, timer["name"], f"expire {_timer_name(timer)}"
        deadline = self.timers.pop(_key(timer), None)
        armed = ", ".join(sorted(self.timers)) or "none"
        if deadline is None:
            raise Diverges(at, f"{what}: not armed", "", [f"one of the armed: {armed}"], "")
        if event.t_ms < deadline:
            wanted = [f"{what} at {deadline} ms"]
            raise Diverges(at, f"{what}: {deadline - event.t_ms} ms too early", "", wanted, "")
        entry, y, session, k = None, timer.get("station", 0), None, 0
        if "message" in timer and timer["message"]["type"] != "Advertisement":
            entry = t.entry_by_seq(timer["message"])
            if entry is None:
                raise Diverges(at, f"{what}: no such message in the outbox", "END-6", [], "")
            y, session, k = entry.to, entry.session, entry.k
        z = next(iter(others(t, y)), 0)
        if not y:
            z = next((p for p in others(t, 0) if p != z), 0) if z else 0
            y = next(iter(others(t, 0)), 0)
        view = View(t, y, z, session, k)
        value: Json = [name]
        if entry is not None:
            value = [name, view.entry(entry)]
        elif "message" in timer:
            value = [name, ["Advertisement", 0, view.sessions(t.session), 1, False]]
        elif name == "forget":
            value = [name, view.ids[y]]
        self._start(at, event, view, ["expire", value], what)

    def _start(
        self,
        at: int,
        event: Event,
        view: View,
        value: Json,
        what: str,
        *,
        given: dict[str, Json] | None = None,
        content: dict[str, Json] | None = None,
    ) -> None:
        """Ask the oracle, for each other recorded station too if the input is about all."""
        answer = self._ask(view, value)
        messages = [expected(view, m, given) for m in answer.effect.messages]
        arm = [(view, timer) for timer in answer.effect.arm]
        for p in self._all_recorded(view, value):
            more = View(self.track, view.real_id(Y), p, view.event_session)
            effect = self._ask(more, value).effect
            about_p = [expected(more, m, given) for m in effect.messages]
            messages += [e for e in about_p if e.dst == p]
            arm += [(more, t) for t in effect.arm if len(t) > 1 and t[1][1] == more.ids[p]]
        told = answer.effect.told
        self._step = Step(
            at,
            event.t_ms,
            value,
            what,
            view,
            answer,
            messages,
            arm,
            [(view, timer) for timer in answer.effect.stop],
            [] if told == ["nothing"] else [told[0]],
            given,
            content or {},
        )

    def _all_recorded(self, view: View, value: Json) -> list[int]:
        """Recorded stations out of view that a choice, an abort or its absence is about."""
        t = self.track
        about_all = value[0] == "command" or value in (["expire", ["decide"]],)
        if not about_all or t.phase not in ("ADVERTISING", "CHOOSING"):
            return []
        return [p for p in t.recorded if p not in view.ids]

    def _ask(self, view: View, value: Json) -> Answer:
        state = view.state()
        try:
            return _oracle(len(view.ids) > 2).ask(state, value)
        except KeyError:
            raise CannotTell(f"not in the oracle: {value} in {state}") from None

    # -- effects

    def _current(self, at: int, event: str) -> Step:
        if self._step is None:
            raise Diverges(at, f"{event}: nothing called for it", "", [], "")
        return self._step

    def _sent(self, at: int, m: dict[str, Json]) -> None:
        event = f"send {m['type']} to {m.get('dst', 'all')}"
        step = self._current(at, event)
        problems = []
        for e in step.messages:
            problem = difference(e, m, self.track, step.content, step.fresh)
            if problem is None:
                step.messages.remove(e)
                step.sent.append((e, m))
                step.fresh += bool(e.k and e.copy_of is None)
                return
            if e.type == m["type"]:
                problems.append(problem)
        why = f" ({problems[0]})" if problems else ""
        wanted = [str(e) for e in step.messages] or ["nothing more"]
        raise Diverges(at, f"{event}{why}", step.rule, wanted, step.guard)

    def _cam_sent(self, at: int, m: dict[str, Json]) -> None:
        """ACT-5: the marks are the bound session and those whose Fin is still being sent."""
        wanted = self.track.marks
        if sorted(m["marks"]) != wanted:
            raise Diverges(
                at, f"send CAM: marks {m['marks']}", "ACT-5", [f"marks {wanted}"], RULES["ACT-5"]
            )

    def _told(self, at: int, event: ApplicationIndication) -> None:
        name = event.indication.name
        if self._step is None and name == "discarded":
            return
        step = self._current(at, f"indication {name}")
        if name not in step.told:
            wanted = step.told or ["nothing"]
            raise Diverges(at, f"indication {name}", step.rule, wanted, step.guard)
        step.told.remove(name)
        fields = event.indication.model_extra or {}
        told = step.answer.effect.told
        if name == "fallback" and "reason" in fields:
            reason = told[1] if told[1] != "as_sent" or not step.given else step.given["reason"]
            if fields["reason"] != reason:
                event_text = f"indication fallback ({fields['reason']})"
                raise Diverges(at, event_text, step.rule, [f"fallback ({reason})"], step.guard)

    def _timer_changed(self, at: int, event: TimerArm | TimerEnd) -> None:
        timer = event.timer.model_dump(exclude_none=True)
        what = f"{event.op} {_timer_name(timer)}"
        step = self._current(at, what)
        pool = step.arm if isinstance(event, TimerArm) else step.stop
        value = self._match(step, timer, pool)
        ends_all = step.input[0] == "restart" and not isinstance(event, TimerArm)
        if ends_all and self.timers.pop(_key(timer), None) is not None:
            return
        if value is None:
            wanted = [f"{event.op} {_name(v)}" for _, v in pool] or ["no timer"]
            raise Diverges(at, what, step.rule, wanted, step.guard)
        pool.remove(value)
        if not isinstance(event, TimerArm):
            self.timers.pop(_key(timer), None)
            return
        duration = self._duration(step, timer)
        if duration is not None and event.deadline != event.t_ms + duration:
            wanted = [f"{what} until {event.t_ms + duration} ms"]
            event_text = f"{what} until {event.deadline} ms"
            raise Diverges(at, event_text, step.rule, wanted, step.guard)
        self.timers[_key(timer)] = event.deadline

    def _match(
        self, step: Step, timer: dict[str, Json], pool: list[tuple[View, Json]]
    ) -> tuple[View, Json] | None:
        """The oracle's timer that this one is."""
        for view, value in pool:
            if value[0] != timer["name"]:
                continue
            if value[0] == "forget" and view.real_id(value[1]) != timer.get("station"):
                continue
            if value[0] in ("resend", "giveup") and not self._about(step, view, timer, value[1]):
                continue
            return view, value
        return None

    def _about(self, step: Step, view: View, timer: dict[str, Json], entry: Json) -> bool:
        """Whether a timer of a message is the oracle's timer of that entry."""
        named = timer.get("message")
        if named is None:
            return False
        type_, to, session, k, _ = entry
        if named["type"] != type_ or named.get("to", 0) != (view.real_id(to) if to else 0):
            return False
        if type_ == "Advertisement":
            return True
        for e, m in step.sent:
            if (e.type, e.dst, m["seq"]) == (type_, named["to"], named["seq"]):
                return True
        found = self.track.entry_by_seq(named)
        return found is not None and view.entry(found)[2:4] == [session, k]

    def _duration(self, step: Step, timer: dict[str, Json]) -> int | None:
        if timer["name"] != "lease":
            return self._durations.get(timer["name"])
        for e, m in step.sent:
            if e.type == "Prescription":
                return int(m["lease_ms"])
        return self.track.lease_ms or None

    def _missed(self, at: int, event: Event) -> None:
        """A timer that should have fired long before this event."""
        for name, deadline in self.timers.items():
            if event.t_ms > deadline + self._late_ms:
                wanted = [f"expire {name} at {deadline} ms"]
                raise Diverges(at, f"{name} was due at {deadline} ms", "REL-1", wanted, "")


def _sum(a: int | None, b: int | None) -> int | None:
    return None if a is None or b is None else a + b


def _template(type_: str, src: int, dst: int, session: Json) -> Json:
    """The alphabet's one message of a type that comes from or goes to where it must not."""
    proposal = 1 if type_ in ("Prescription", "Acceptance") else 0
    reason = "as_sent" if type_ == "Cancel" else "none"
    of = ["Cancel", 1] if type_ == "Ack" else ["none", 0]
    k = 0 if type_ == "Ack" else 1
    return [type_, src, dst, session, k, proposal, type_ == "Acceptance", reason, of]


def _timer_name(timer: dict[str, Json]) -> str:
    m = timer.get("message")
    if m is not None:
        return f"{timer['name']}({m['type']} seq={m['seq']} to {m.get('to', 'all')})"
    return f"{timer['name']}({timer['station']})" if "station" in timer else str(timer["name"])


def _key(timer: dict[str, Json]) -> str:
    m = timer.get("message")
    return _timer_name(timer) + (f" session={m['session'][0]}/{m['session'][1]}" if m else "")


def _name(value: Json) -> str:
    """A timer of the oracle in words."""
    if value[0] in ("resend", "giveup"):
        return f"{value[0]}({value[1][0]})"
    return str(value[0])
