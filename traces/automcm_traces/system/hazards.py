"""S-5 and T-2: the prescriber acts although its target is not committed, and for how long.

T-2 (docs/verification.md, section 4) bounds the hazard by D + t_cam_loss, where D is the longest
delay of a copy, here half of ``t_resend``; and by the lease, if that is shorter.  A timer that
expired late in the log lengthens the bound by as much: the theorem counts due timers as fired.

S-5 and T-2 assume that nobody sends in the name of another.  A forged message that begins a hazard
therefore excuses it, and T-2 bounds no hazard that a forged message has begun or prolonged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from automcm_spec.vocabulary.messages import Fields
from automcm_spec.vocabulary.parameters import DEFAULTS
from automcm_traces.format.log import Receive
from automcm_traces.system.clock_offsets import Span
from automcm_traces.system.timeline import Session, Spell, Timeline, session_of
from automcm_traces.system.world import World

EXCUSES = {
    "restart": "restarts",
    "command abort": "aborts",
    "expire cam": "loses the CAMs",
    "stopped": "dies",
}
"""What excuses a hazard (S-5), and what it is that the target does.  A log that stops stands for a
restart that never comes."""


@dataclass(frozen=True, slots=True)
class Bound:
    """What T-2 allows, in ms, and how that comes about."""

    ms: int
    text: str


@dataclass(frozen=True, slots=True)
class Hazard:
    """A time in which the prescriber acted and its target was not committed."""

    session: Session
    prescriber: int
    target: int
    since: str
    """``FILE:LINE`` of the event with which it began, and its time on that station's clock."""
    since_ms: int
    until: str
    until_ms: int
    length: Span | None
    """None: the clocks of the two cannot be compared."""
    open: bool
    """The prescriber still acts where its log ends: it lasted at least as long."""
    fault: str
    between: tuple[str, ...]
    """What else happened, in words."""
    ended: str
    excused: bool
    """By S-5: the target itself aborted, lost CAMs, restarted or died; or by a forged message."""
    bound: Bound | None
    outcome: Literal["within", "exceeds", "cannot_tell"]
    """Against the bound."""
    why: str = ""
    begun_by: str = ""
    """The forged message that began it, such as ``Cancel from 1, at FILE:LINE``; empty if none."""
    prolonged_by: str = ""
    """Likewise the last forged CAM without which the prescriber would have left earlier."""

    def as_dict(self) -> dict[str, object]:
        """As in ``--json``."""
        return {
            "session": list(self.session),
            "prescriber": self.prescriber,
            "target": self.target,
            "since": self.since,
            "since_ms": self.since_ms,
            "until": self.until,
            "until_ms": self.until_ms,
            "length": None if self.length is None else self.length.as_dict(),
            "open": self.open,
            "fault": self.fault,
            "between": list(self.between),
            "ended": self.ended,
            "excused": self.excused,
            "bound_ms": None if self.bound is None else self.bound.ms,
            "bound": None if self.bound is None else self.bound.text,
            "outcome": self.outcome,
            "why": self.why,
            "begun_by": self.begun_by,
            "prolonged_by": self.prolonged_by,
        }

    def text(self) -> str:
        """A few lines for a person."""
        least = "at least " if self.open else ""
        length = "unknown length" if self.length is None else f"{least}{self.length}"
        kind = "hazard (fault)" if self.excused else "HAZARD WITHOUT EXCUSE (S-5)"
        if self.begun_by:
            kind = "hazard (forged message)"
        lines = [
            f"{kind}, session {self.session[0]}/{self.session[1]}: {length}",
            f"  from  {self.since} ({self.since_ms} ms): {self.fault}",
            *([f"  begun by forged {self.begun_by}"] if self.begun_by else []),
            *([f"  prolonged by forged {self.prolonged_by}"] if self.prolonged_by else []),
            f"  to    {self.until} ({self.until_ms} ms): {self.ended}",
            *(f"  between: {text}" for text in self.between),
        ]
        if self.bound is not None:
            verdict = {
                "within": "kept",
                "exceeds": "EXCEEDED",
                "cannot_tell": "cannot tell",
            }[self.outcome]
            lines.append(f"  T-2 bound {self.bound.text}: {verdict}")
        return "\n".join([*lines, f"  {self.why}"] if self.why else lines)


class CannotJudge(Exception):
    """A hazard can neither be shown nor excluded; the text says why."""


@dataclass(frozen=True, slots=True)
class _Gone:
    """Where the target's commitment is over."""

    at: int
    line: int
    t_ms: int
    cause: str
    text: str


def hazard(world: World, acts: Spell) -> Hazard | None:
    """The hazard while the prescriber acts in one spell, if there is one.

    Raises CannotJudge if the logs do not tell.
    """
    target, session = acts.start.target, acts.session
    assert session is not None, "a station that acts is bound"
    line = world.timelines.get(target)
    if line is None:
        raise CannotJudge(f"no log of station {target}, the target of {session[0]}/{session[1]}")
    committed = world.committed(target, session, acts.start.proposal)
    if not committed:
        return _never(world, acts, line)
    held = committed[-1]
    early = world.elapsed(acts.station, acts.start.t_ms, target, held.start.t_ms)
    if early is not None and early.low > 0:
        return _early(world, acts, held, early)
    gone = _gone(world, acts, held, line)
    return None if gone is None else _after(world, acts, target, gone)


def _never(world: World, acts: Spell, line: Timeline) -> Hazard:
    known = world.elapsed(line.station, line.last[2], acts.station, acts.start.t_ms)
    if line.ending != "clean" or known is None or known.low > 0:
        raise CannotJudge(f"station {line.station} is not known long enough: {line.why}")
    own = world.timelines[acts.station]
    begin = _Gone(acts.start.at, acts.start.line, acts.start.t_ms, "", "")
    text = f"station {line.station} never committed to proposal {acts.start.proposal}"
    return _made(world, acts, line.station, begin, own, text)


def _early(world: World, acts: Spell, held: Spell, length: Span) -> Hazard:
    assert acts.session is not None
    own, line = world.timelines[acts.station], world.timelines[held.station]
    begun_by = _forged(world, acts.station, acts.start.at)
    bound = bound_of(world, acts) if begun_by else None
    outcome, why = _outcome(world, acts, held.station, length, bound, bool(begun_by))
    return Hazard(
        acts.session,
        acts.station,
        held.station,
        own.where(acts.start),
        acts.start.t_ms,
        line.where(held.start),
        held.start.t_ms,
        length,
        False,
        f"station {acts.station} acts, and station {held.station} has not accepted",
        (),
        f"station {held.station} accepts",
        bool(begun_by),
        bound,
        outcome if begun_by else "exceeds",
        why if begun_by else "",
        begun_by,
    )


def _gone(world: World, acts: Spell, held: Spell, line: Timeline) -> _Gone | None:
    """Where the commitment is over; None if the prescriber does not act for longer than that."""
    target = held.station
    if held.end is not None:
        end = held.end
        told = world.told(target, end)
        text = EXCUSES.get(end.cause, f"leaves by {end.cause}")
        rule = f" by {end.rule}" if end.rule else ""
        more = f", told {told}" if told else ""
        return _Gone(end.at, end.line, end.t_ms, end.cause, f"station {target} {text}{rule}{more}")
    finish = acts.end.t_ms if acts.end is not None else world.timelines[acts.station].last[2]
    known = world.elapsed(acts.station, finish, target, line.last[2])
    if known is not None and known.low >= 0:
        return None
    own = world.timelines[acts.station]
    if line.ending == "stopped" and not (acts.end is None and own.ending == "stopped"):
        text = f"station {target} dies: {line.why}"
        return _Gone(line.last[0], line.last[1], line.last[2], "stopped", text)
    if line.ending == "clean" and acts.end is None:
        return None  # both are watched to the end of the run
    raise CannotJudge(f"station {target} is committed where it is last known: {line.why}")


def _after(world: World, acts: Spell, target: int, gone: _Gone) -> Hazard | None:
    """The hazard, if any, of a prescriber whose target is gone."""
    own, line = world.timelines[acts.station], world.timelines[target]
    ended = acts.end
    stopped = gone.cause == "stopped"
    if ended is not None and world.before(acts.station, ended.at, target, gone.at):
        return None
    finish = own.last[2] if ended is None else ended.t_ms
    length = world.elapsed(target, gone.t_ms, acts.station, finish)
    certain = ended is not None and world.before(target, gone.at, acts.station, ended.at)
    excused = gone.cause in EXCUSES or bool(_begun_by(world, acts, target, gone))
    if length is not None and length.high <= 0:
        if ended is None:
            why = f"station {acts.station} acts where its log ends, and later {gone.text}"
            raise CannotJudge(f"{why} ({line.file}:{gone.line})")
        return None
    if length is None or (length.low <= 0 and not certain):
        if length is not None and excused and length.best <= 0:
            return None
        if not excused and (length is None or length.best <= 0 or not certain):
            where = f"{line.file}:{gone.line}"
            raise CannotJudge(f"who left first is not known: {gone.text} ({where})")
    late = world.elapsed(target, gone.t_ms, acts.station, acts.start.t_ms)
    if late is not None and late.low > 0:  # gone before the prescriber acted at all
        begin = _Gone(acts.start.at, acts.start.line, acts.start.t_ms, gone.cause, gone.text)
        text = f"{gone.text} ({line.file}:{gone.line}) before station {acts.station} acts"
        return _made(world, acts, target, begin, own, text, gone)
    text = gone.text
    if stopped and length is not None:
        length = Span(max(0, length.low), length.high, max(0, length.best), length.assumed)
    return _made(world, acts, target, gone, line, text, gone, length)


def _made(
    world: World,
    acts: Spell,
    target: int,
    begin: _Gone,
    where: Timeline,
    fault: str,
    gone: _Gone | None = None,
    length: Span | None = None,
) -> Hazard:
    assert acts.session is not None
    own, end = world.timelines[acts.station], acts.end
    _, until_line, until_ms = own.last if end is None else (end.at, end.line, end.t_ms)
    if where is own:
        ms = until_ms - begin.t_ms
        length = Span(ms, ms, ms)
    ended = f"station {acts.station} still acts where its log ends"
    if end is not None:
        told = world.told(acts.station, end)
        ended = f"station {acts.station} leaves at {end.cause} by {end.rule}"
        ended += f", told {told}" if told else ""
    cause = "" if gone is None else gone.cause
    bound = bound_of(world, acts)
    begun_by = _begun_by(world, acts, target, gone)
    prolonged_by = _prolonged_by(world, acts, target, until_ms)
    forged = bool(begun_by or prolonged_by)
    outcome, why = _outcome(world, acts, target, length, bound, forged)
    return Hazard(
        acts.session,
        acts.station,
        target,
        f"{where.file}:{begin.line}",
        begin.t_ms,
        f"{own.file}:{until_line}",
        until_ms,
        length,
        end is None,
        fault,
        tuple(_between(world, acts, target, gone)) if gone is not None else (),
        ended,
        cause in EXCUSES or bool(begun_by),
        bound,
        outcome,
        why,
        begun_by,
        prolonged_by,
    )


def _begun_by(world: World, acts: Spell, target: int, gone: _Gone | None) -> str:
    """The forged message that began a hazard: by it the prescriber acts, or the target leaves, or
    the target has another lease.  Empty if there is none."""
    found = _forged(world, acts.station, acts.start.at)
    if gone is not None and not found:
        found = _forged(world, target, gone.at)
    if gone is not None and not found and gone.cause == "expire lease":
        found = _forged(world, target, _prescribed(world, acts, target))
    return found


def _prescribed(world: World, acts: Spell, target: int) -> int:
    """The event with which the target first received what the prescriber acts on; -1 if none."""
    for at, (_, e) in enumerate(world.log(target).events):
        m: Fields = (isinstance(e, Receive) and e.message) or {}
        what = m.get("type"), session_of(m), m.get("proposal")
        if what == ("Prescription", acts.session, acts.start.proposal):
            return at
    return -1


def _prolonged_by(world: World, acts: Spell, target: int, until_ms: int) -> str:
    """The forged CAM without which the prescriber would have lost the CAMs before it left; empty
    if there is none, or the header does not tell t_cam_loss."""
    loss = world.log(acts.station).header.known.get("t_cam_loss")
    heard_ms, forged = acts.start.t_ms, ""
    for at, t_ms in [*_cams(world, acts, target), (-1, until_ms)]:
        if 0 <= at <= acts.start.at:
            continue
        if found := _forged(world, acts.station, at):
            forged = found
            continue
        if forged and loss is not None and t_ms - heard_ms > loss:
            return forged
        heard_ms, forged = t_ms, ""
    return ""


def _forged(world: World, station: int, at: int) -> str:
    """The message received in an event, if it is forged, and where; else empty."""
    found = world.forged(station, at)
    return "" if found is None else f"{found.message}, at {found.file}:{found.line}"


def _outcome(
    world: World,
    acts: Spell,
    target: int,
    length: Span | None,
    bound: Bound | None,
    forged: bool,
) -> tuple[Literal["within", "exceeds", "cannot_tell"], str]:
    if bound is None:
        return "cannot_tell", "the header does not tell t_cam_loss"
    if length is None:
        return "cannot_tell", "the clocks of the two stations cannot be compared"
    limit = bound.ms
    delay = world.log(acts.station).header.longest_delay
    slow = world.slowest(target, acts.station)
    if length.low > limit:
        if forged:
            return "cannot_tell", "T-2 assumes that no message is forged"
        if slow > delay:
            return "cannot_tell", (
                f"T-2 assumes delays of at most {delay} ms; a copy was under way for {slow} ms"
            )
        return "exceeds", ""
    if length.high <= limit:
        return "within", ""
    return "cannot_tell", "the bound lies within what the clocks leave open"


def bound_of(world: World, acts: Spell) -> Bound | None:
    """B = D + t_cam_loss, or the lease if that is shorter; and how late the timer was that
    ended the prescriber's part.  None if the header does not tell t_cam_loss."""
    header = world.log(acts.station).header
    d, loss = header.longest_delay, header.known.get("t_cam_loss")
    if loss is None:
        return None
    ms, text = d + loss, f"D + t_cam_loss = {d} + {loss}"
    assert acts.session is not None, "a station that acts is bound"
    lease = world.leases(acts.station).get((acts.session, acts.start.proposal))
    if lease is not None and lease < ms:
        ms, text = lease, f"lease = {lease}"
    late = acts.end.late_ms if acts.end is not None else 0
    if late > 0:
        ms, text = ms + late, f"{text}, and the timer {late} late"
    return Bound(ms, f"{text}: {ms} ms")


def _between(world: World, acts: Spell, target: int, gone: _Gone) -> list[str]:
    """What the radio did to the messages that could have shortened the hazard."""
    found = []
    if gone.cause == "expire cam":
        ms = world.log(target).header.known.get("t_cam_loss") or DEFAULTS["t_cam_loss"]
        ahead = world.elapsed(target, gone.t_ms - ms, acts.station, 0)
        if ahead is not None:
            first, to = (world.place_at(acts.station, t - ahead.best) for t in (0, ms))
            when = f" in the {ms} ms before"
            found.append(_count(world, acts.station, target, first, to - 1, "CAM", when))
    if gone.cause != "stopped":
        found.append(_count(world, target, acts.station, gone.at, None, "Cancel", " from then on"))
    return [*found, _last_cam(world, acts, target)]


def _last_cam(world: World, acts: Spell, target: int) -> str:
    """The last CAM of the target that named the session and reached the prescriber (ACT-5)."""
    log = world.log(acts.station)
    cams = _cams(world, acts, target)
    if not cams:
        return f"no CAM of station {target} that counts has come"
    at, t_ms = cams[-1]
    return f"the last CAM that counts came at {log.file}:{log.events[at][0]} ({t_ms} ms)"


def _cams(world: World, acts: Spell, target: int) -> list[tuple[int, int]]:
    """The CAMs of the target that named the session and reached the prescriber before it left
    (ACT-5): place of the event and time."""
    events = world.log(acts.station).events
    found = []
    for at in range(acts.end.at if acts.end is not None else len(events)):
        e = events[at][1]
        if isinstance(e, Receive) and e.message is not None and e.message.get("src") == target:
            marks = e.message.get("marks")
            if isinstance(marks, list) and list(acts.session or ()) in marks:
                found.append((at, e.t_ms))
    return found


def _count(
    world: World, src: int, dst: int, first: int, last: int | None, type_: str, when: str
) -> str:
    n = world.deliveries.between(src, dst, first, last, type_)
    sent = sum(n.values())
    arrived = n["delivered"] + n["duplicated"]
    return f"{sent} {type_}s of {src} to {dst}{when}: {arrived} arrived"
