"""Checks S-5 and T-2: a prescriber acts although its target is not committed, and for how long.

T-2 (docs/verification.md, section 4) bounds the hazard by D + t_cam_loss, where D is the longest
delay of a copy, here half of ``t_resend``, or by the lease if it is shorter. A timer that expires
late in the log extends the bound by its delay: the theorem assumes that due timers fire at once.

S-5 and T-2 assume that no station sends in the name of another. So a forged message that begins a
hazard excuses it, and T-2 bounds no hazard that a forged message has begun or prolonged.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Literal

from automcm_spec.log_format.log import Receive
from automcm_spec.support.bad_input import printable
from automcm_spec.vocabulary.parameters import DEFAULTS
from automcm_traces.system.log_clocks import Span
from automcm_traces.system.timeline import Moment, Period, Session, Timeline
from automcm_traces.system.world import World

EXCUSES = {
    "restart": "restarts",
    "command abort": "aborts",
    "expire cam": "loses the CAMs",
    "stopped": "dies",
}
"""The causes that excuse a hazard (S-5), and the text for each. A log that stops stands for a
restart that never comes."""


@dataclass(frozen=True, slots=True)
class Bound:
    """The bound of T-2 in ms, and its derivation."""

    ms: int
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Hazard:
    """A period in which the prescriber acted and its target was not committed."""

    session: Session
    prescriber: int
    target: int
    since: str
    """``FILE:LINE`` of the event that began it; its time is on that station's clock."""
    since_ms: int
    until: str
    until_ms: int
    length: Span | None
    """None if the clocks of the two stations cannot be compared."""
    open: bool
    """Whether the prescriber still acts at the end of its log; then the length is a lower bound."""
    fault: str
    between: tuple[str, ...]
    """Other relevant events, as text."""
    ended: str
    excused: bool
    """By S-5: the target aborted, lost CAMs, restarted or died; or by a forged message."""
    bound: Bound | None
    outcome: Literal["within", "exceeds", "cannot_tell"]
    """The comparison with the bound."""
    why: str = ""
    begun_by: str = ""
    """The forged message that began it, such as ``Cancel from 1, at FILE:LINE``; empty if there is
    none."""
    prolonged_by: str = ""
    """The last forged CAM without which the prescriber would have left earlier; empty if there is
    none."""

    def as_dict(self) -> dict[str, object]:
        """The ``--json`` form."""
        found = {each.name: getattr(self, each.name) for each in fields(self)}
        length = None if self.length is None else self.length.as_dict()
        ms, text = (None, None) if self.bound is None else (self.bound.ms, self.bound.text)
        return found | {"length": length, "bound_ms": ms, "bound": text}

    def text(self, start_ms: Mapping[str, int] | None = None) -> str:
        """A few lines of text. ``start_ms`` has the time that counts as 0, by file."""
        since, until = (
            f"{where} ({t_ms - (start_ms or {}).get(where.rpartition(':')[0], 0)} ms)"
            for where, t_ms in ((self.since, self.since_ms), (self.until, self.until_ms))
        )
        least = "at least " if self.open else ""
        length = "unknown length" if self.length is None else f"{least}{self.length}"
        kind = "hazard (fault)" if self.excused else "HAZARD WITHOUT EXCUSE (S-5)"
        if self.begun_by:
            kind = "hazard (forged message)"
        lines = [
            f"{kind}, session {self.session[0]}/{self.session[1]}: {length}",
            f"  from  {since}: {self.fault}",
            *([f"  begun by forged {self.begun_by}"] if self.begun_by else []),
            *([f"  prolonged by forged {self.prolonged_by}"] if self.prolonged_by else []),
            f"  to    {until}: {self.ended}",
            *(f"  between: {text}" for text in self.between),
        ]
        if self.bound is not None:
            verdict = {
                "within": "kept",
                "exceeds": "EXCEEDED",
                "cannot_tell": "cannot tell",
            }[self.outcome]
            lines.append(f"  T-2 bound {self.bound.text}: {verdict}")
        return "\n".join(map(printable, [*lines, f"  {self.why}"] if self.why else lines))


class CannotJudge(Exception):
    """The logs neither show nor exclude a hazard; the text says why."""


def hazard(world: World, acts: Period) -> Hazard | None:
    """The hazard during one period in which the prescriber acts; None if there is none.

    Raises CannotJudge if the logs do not determine it.
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
    departure = _departure(world, acts, held, line)
    return None if departure is None else _after(world, acts, target, *departure)


def _never(world: World, acts: Period, line: Timeline) -> Hazard:
    known = world.elapsed(line.station, line.last[2], acts.station, acts.start.t_ms)
    if line.ending != "clean" or known is None or known.low > 0:
        raise CannotJudge(f"the log of station {line.station} ends too early: {line.why}")
    own = world.timelines[acts.station]
    text = f"station {line.station} never committed to proposal {acts.start.proposal}"
    return _made(world, acts, line.station, acts.start, own, text)


def _early(world: World, acts: Period, held: Period, length: Span) -> Hazard:
    own, line = world.timelines[acts.station], world.timelines[held.station]
    text = f"station {acts.station} acts before station {held.station} accepts"
    found = replace(
        _made(world, acts, held.station, acts.start, own, text, length=length),
        until=line.where(held.start),
        until_ms=held.start.t_ms,
        open=False,
        ended=f"station {held.station} accepts",
        prolonged_by="",
    )
    return found if found.begun_by else replace(found, bound=None, outcome="exceeds", why="")


def _departure(
    world: World, acts: Period, held: Period, line: Timeline
) -> tuple[Moment, str] | None:
    """The end of the commitment, and its text; None if the prescriber does not act beyond it."""
    target = held.station
    if held.end is not None:
        end = held.end
        text = f"station {target} {EXCUSES.get(end.cause, f'leaves by {end.cause}')}"
        text += (f" by {end.rule}" if end.rule else "") + world.told(target, end)
        return end, text
    finish = acts.end.t_ms if acts.end is not None else world.timelines[acts.station].last[2]
    known = world.elapsed(acts.station, finish, target, line.last[2])
    if known is not None and known.low >= 0:
        return None
    own = world.timelines[acts.station]
    if line.ending == "stopped" and not (acts.end is None and own.ending == "stopped"):
        text = f"station {target} dies: {line.why}"
        return Moment(*line.last, cause="stopped"), text
    if line.ending == "clean" and acts.end is None:
        return None  # both logs reach the end of the run
    raise CannotJudge(f"station {target} is still committed at the end: {line.why}")


def _after(world: World, acts: Period, target: int, departure: Moment, text: str) -> Hazard | None:
    """The hazard of a prescriber whose target has left; None if there is none."""
    own, line = world.timelines[acts.station], world.timelines[target]
    ended = acts.end
    stopped = departure.cause == "stopped"
    if ended is not None and world.before(acts.station, ended.at, target, departure.at):
        return None
    finish = own.last[2] if ended is None else ended.t_ms
    length = world.elapsed(target, departure.t_ms, acts.station, finish)
    certain = ended is not None and world.before(target, departure.at, acts.station, ended.at)
    excused = departure.cause in EXCUSES or bool(_begun_by(world, acts, target, departure))
    if length is not None and length.high <= 0:
        if ended is None:
            why = f"station {acts.station} acts at the end of its log, and later {text}"
            raise CannotJudge(f"{why} ({line.file}:{departure.line})")
        return None
    if length is None or (length.low <= 0 and not certain):
        if length is not None and excused and length.best <= 0:
            return None
        if not excused and (length is None or length.best <= 0 or not certain):
            where = f"{line.file}:{departure.line}"
            raise CannotJudge(f"it is unknown which station left first: {text} ({where})")
    late = world.elapsed(target, departure.t_ms, acts.station, acts.start.t_ms)
    if late is not None and late.low > 0:  # the target left before the prescriber acted
        text = f"{text} ({line.file}:{departure.line}) before station {acts.station} acts"
        return _made(world, acts, target, acts.start, own, text, departure)
    if stopped and length is not None:
        length = Span(max(0, length.low), length.high, max(0, length.best), length.assumed)
    return _made(world, acts, target, departure, line, text, departure, length)


def _made(
    world: World,
    acts: Period,
    target: int,
    begin: Moment,
    where: Timeline,
    fault: str,
    departure: Moment | None = None,
    length: Span | None = None,
) -> Hazard:
    assert acts.session is not None
    own, end = world.timelines[acts.station], acts.end
    _, until_line, until_ms = own.last if end is None else (end.at, end.line, end.t_ms)
    if where is own and length is None:
        ms = until_ms - begin.t_ms
        length = Span(ms, ms, ms)
    ended = f"station {acts.station} still acts at the end of its log"
    if end is not None:
        ended = f"station {acts.station} leaves at {end.cause} by {end.rule}"
        ended += world.told(acts.station, end)
    cause = "" if departure is None else departure.cause
    bound = bound_of(world, acts)
    begun_by = _begun_by(world, acts, target, departure)
    prolonged_by = _prolonged_by(world, acts, target, until_ms)
    forged = bool(begun_by or prolonged_by)
    outcome, why = _outcome(world, acts, target, length, bound, forged)
    return Hazard(
        session=acts.session,
        prescriber=acts.station,
        target=target,
        since=f"{where.file}:{begin.line}",
        since_ms=begin.t_ms,
        until=f"{own.file}:{until_line}",
        until_ms=until_ms,
        length=length,
        open=end is None,
        fault=fault,
        between=tuple(_between(world, acts, target, departure)) if departure is not None else (),
        ended=ended,
        excused=cause in EXCUSES or bool(begun_by),
        bound=bound,
        outcome=outcome,
        why=why,
        begun_by=begun_by,
        prolonged_by=prolonged_by,
    )


def _begun_by(world: World, acts: Period, target: int, departure: Moment | None) -> str:
    """The forged message that began a hazard; empty if there is none.

    Because of it the prescriber acts, or the target leaves, or the target has another lease.
    """
    found = world.forged(acts.station, acts.start.at)
    if departure is not None and not found:
        found = world.forged(target, departure.at)
    if departure is not None and not found and departure.cause == "expire lease":
        about = target, acts.session, acts.start.proposal
        received = world.messages("Prescription", Receive)
        first = next((at for s, at, _, *named in received if (s, *named) == about), -1)
        found = world.forged(target, first)
    return found


def _prolonged_by(world: World, acts: Period, target: int, until_ms: int) -> str:
    """The forged CAM without which the prescriber would have detected CAM loss before it left.

    Empty if there is none, or if the header lacks t_cam_loss.
    """
    loss = world.log(acts.station).header.known.get("t_cam_loss")
    last_cam_ms, forged = acts.start.t_ms, ""
    for at, t_ms in [*_cams(world, acts, target), (-1, until_ms)]:
        if 0 <= at <= acts.start.at:
            continue
        if found := world.forged(acts.station, at):
            forged = found
            continue
        if forged and loss is not None and t_ms - last_cam_ms > loss:
            return forged
        last_cam_ms, forged = t_ms, ""
    return ""


def _outcome(
    world: World,
    acts: Period,
    target: int,
    length: Span | None,
    bound: Bound | None,
    forged: bool,
) -> tuple[Literal["within", "exceeds", "cannot_tell"], str]:
    if bound is None:
        return "cannot_tell", "`parameters` in the header lacks t_cam_loss"
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
                f"T-2 assumes delays of at most {delay} ms; a copy took {slow} ms"
            )
        return "exceeds", ""
    if length.high <= limit:
        return "within", ""
    return "cannot_tell", "the bound lies within the uncertainty of the clocks"


def bound_of(world: World, acts: Period) -> Bound | None:
    """B = D + t_cam_loss, or the lease if it is shorter, plus the delay of the timer that ended the
    prescriber's part. None if the header lacks t_cam_loss."""
    header = world.log(acts.station).header
    d, loss = header.longest_delay, header.known.get("t_cam_loss")
    if loss is None:
        return None
    ms, text = d + loss, f"D + t_cam_loss = {d} + {loss}"
    assert acts.session is not None, "a station that acts is bound"
    lease = world.leases[acts.station].get((acts.session, acts.start.proposal))
    if lease is not None and lease < ms:
        ms, text = lease, f"lease = {lease}"
    late = acts.end.late_ms if acts.end is not None else 0
    if late > 0:
        ms, text = ms + late, f"{text}, and the timer {late} late"
    return Bound(ms, f"{text}: {ms} ms")


def _between(world: World, acts: Period, target: int, departure: Moment) -> list[str]:
    """The fate of the messages that could have shortened the hazard."""
    found = []
    if departure.cause == "expire cam":
        ms = world.log(target).header.known.get("t_cam_loss") or DEFAULTS["t_cam_loss"]
        ahead = world.elapsed(target, departure.t_ms - ms, acts.station, 0)
        if ahead is not None:
            events = world.log(acts.station).events
            first, to = (
                bisect_left(events, t - ahead.best, key=lambda entry: entry[1].t_ms)
                for t in (0, ms)
            )
            when = f" in the {ms} ms before"
            found.append(_count(world, acts.station, target, first, to - 1, "CAM", when))
    if departure.cause != "stopped":
        found.append(
            _count(world, target, acts.station, departure.at, None, "Cancel", " from then on")
        )
    log, cams = world.log(acts.station), _cams(world, acts, target)
    if not cams:
        return [*found, f"no CAM of station {target} counted"]
    return [*found, f"the last CAM that counted was at {log.file}:{log.events[cams[-1][0]][0]}"]


def _cams(world: World, acts: Period, target: int) -> list[tuple[int, int]]:
    """The CAMs of the target that named the session and reached the prescriber before it left
    (ACT-5): index of the event, and time."""
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
