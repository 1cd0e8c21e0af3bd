"""Checks S-5 and T-2: a prescriber acts although its target is not committed, and for how long.

T-2 (docs/verification.md, section 4) bounds the hazard by D + t_cam_loss, where D is the longest
delay of a copy, here half of ``t_resend``, or by the lease if it is shorter. A timer that expires
late in the log extends the bound by its delay: the theorem assumes that due timers fire at once.

S-5 and T-2 assume that no station sends in the name of another. So a forged message that begins a
hazard excuses it, and T-2 bounds no hazard that a forged message has begun or prolonged.
"""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Literal

from automcm_spec.log_format.event_text import plain
from automcm_spec.log_format.log import Receive
from automcm_spec.support.bad_input import printable
from automcm_spec.vocabulary.parameters import DEFAULTS
from automcm_traces.system.delivery import outcomes
from automcm_traces.system.log_clocks import Span
from automcm_traces.system.timeline import Moment, Period, Session
from automcm_traces.system.world import World

EXCUSES = {
    "restart": "restarts",
    "command abort": "aborts",
    "expire cam": "loses the CAMs",
    "stopped": "dies",
}
"""The causes that excuse a hazard (S-5), and the text for each. A log that stops stands for a
restart that never comes."""
KEPT = {"within": "kept", "exceeds": "EXCEEDED", "cannot_tell": "cannot tell"}


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
            f"{kind}, session {plain(self.session)}: {length}",
            f"  from  {since}: {self.fault}",
            *([f"  begun by forged {self.begun_by}"] if self.begun_by else []),
            *([f"  prolonged by forged {self.prolonged_by}"] if self.prolonged_by else []),
            f"  to    {until}: {self.ended}",
            *(f"  between: {text}" for text in self.between),
        ]
        if self.bound is not None:
            lines.append(f"  T-2 bound {self.bound.text}: {KEPT[self.outcome]}")
        return "\n".join(map(printable, [*lines, f"  {self.why}"] if self.why else lines))


class CannotJudge(Exception):
    """The logs neither show nor exclude a hazard; the text says why."""


def hazard(world: World, acts: Period) -> Hazard | None:
    """The hazard during one period in which the prescriber acts; None if there is none.

    Raises CannotJudge if the logs do not determine it.
    """
    target, session = acts.start.target, acts.session
    assert session is not None, "a station that acts is bound"
    if target not in world.timelines:
        raise CannotJudge(f"no log of station {target}, the target of {plain(session)}")
    return _Acting(world, acts, session).hazard()


class _Acting:
    """A period in which a prescriber acts, and what the logs show of its target."""

    def __init__(self, world: World, acts: Period, session: Session) -> None:
        self._world, self._acts, self._session = world, acts, session
        self._station, self._target = acts.station, acts.start.target
        self._own, self._line = world.timelines[acts.station], world.timelines[self._target]
        end = acts.end
        last = self._own.last if end is None else (end.at, end.line, end.t_ms)
        _, self._until_line, self._until_ms = last
        self._known = world.log(acts.station).header.known

    def hazard(self) -> Hazard | None:
        """As ``hazard``."""
        start = self._acts.start
        committed = self._world.committed(self._target, self._session, start.proposal)
        if not committed:
            return self._never()
        held = committed[-1]
        early = self._world.elapsed(self._station, start.t_ms, self._target, held.start.t_ms)
        if early is not None and early.low > 0:
            return self._early(held, early)
        departure = self._departure(held)
        return None if departure is None else self._after(*departure)

    def _never(self) -> Hazard:
        line, start = self._line, self._acts.start
        known = self._world.elapsed(line.station, line.last[2], self._station, start.t_ms)
        if line.ending != "clean" or known is None or known.low > 0:
            raise CannotJudge(f"the log of station {line.station} ends too early: {line.why}")
        text = f"station {line.station} never committed to proposal {start.proposal}"
        return self._made(start, text)

    def _early(self, held: Period, length: Span) -> Hazard:
        text = f"station {self._station} acts before station {held.station} accepts"
        found = replace(
            self._made(self._acts.start, text, length=length),
            until=self._line.where(held.start),
            until_ms=held.start.t_ms,
            open=False,
            ended=f"station {held.station} accepts",
            prolonged_by="",
        )
        return found if found.begun_by else replace(found, bound=None, outcome="exceeds", why="")

    def _departure(self, held: Period) -> tuple[Moment, str] | None:
        """The end of the commitment, and its text; None if the prescriber does not act beyond
        it."""
        target, line, acts = self._target, self._line, self._acts
        if held.end is not None:
            end = held.end
            text = f"station {target} {EXCUSES.get(end.cause, f'leaves by {end.cause}')}"
            text += (f" by {end.rule}" if end.rule else "") + self._world.told(target, end)
            return end, text
        known = self._world.elapsed(self._station, self._until_ms, target, line.last[2])
        if known is not None and known.low >= 0:
            return None
        if line.ending == "stopped" and not (acts.end is None and self._own.ending == "stopped"):
            text = f"station {target} dies: {line.why}"
            return Moment(*line.last, cause="stopped"), text
        if line.ending == "clean" and acts.end is None:
            return None  # both logs reach the end of the run
        raise CannotJudge(f"station {target} is still committed at the end: {line.why}")

    def _after(self, departure: Moment, text: str) -> Hazard | None:
        """The hazard of a prescriber whose target has left; None if there is none."""
        world, station, target, ended = self._world, self._station, self._target, self._acts.end
        if ended is not None and world.before(station, ended.at, target, departure.at):
            return None
        length = world.elapsed(target, departure.t_ms, station, self._until_ms)
        certain = ended is not None and world.before(target, departure.at, station, ended.at)
        excused = departure.cause in EXCUSES or bool(self._begun_by(departure))
        where = self._line.where(departure)
        if length is not None and length.high <= 0:
            if ended is None:
                why = f"station {station} acts at the end of its log, and later {text}"
                raise CannotJudge(f"{why} ({where})")
            return None
        if length is None or (length.low <= 0 and not certain):
            if length is not None and excused and length.best <= 0:
                return None
            if not excused and (length is None or length.best <= 0 or not certain):
                raise CannotJudge(f"it is unknown which station left first: {text} ({where})")
        late = world.elapsed(target, departure.t_ms, station, self._acts.start.t_ms)
        if late is not None and late.low > 0:  # the target left before the prescriber acted
            text = f"{text} ({where}) before station {station} acts"
            return self._made(self._acts.start, text, departure)
        if departure.cause == "stopped" and length is not None:
            length = Span(max(0, length.low), length.high, max(0, length.best), length.assumed)
        return self._made(departure, text, departure, length)

    def _made(
        self, begin: Moment, fault: str, departure: Moment | None = None, length: Span | None = None
    ) -> Hazard:
        station, own, end = self._station, self._own, self._acts.end
        of = own if begin is self._acts.start else self._line
        if of is own and length is None:
            ms = self._until_ms - begin.t_ms
            length = Span(ms, ms, ms)
        ended = f"station {station} still acts at the end of its log"
        if end is not None:
            ended = f"station {station} leaves at {end.cause} by {end.rule}"
            ended += self._world.told(station, end)
        cause = "" if departure is None else departure.cause
        bound, begun_by, prolonged_by = self._bound(), self._begun_by(departure), self._prolonged()
        outcome, why = self._outcome(length, bound, bool(begun_by or prolonged_by))
        return Hazard(
            session=self._session,
            prescriber=station,
            target=self._target,
            since=of.where(begin),
            since_ms=begin.t_ms,
            until=f"{own.file}:{self._until_line}",
            until_ms=self._until_ms,
            length=length,
            open=end is None,
            fault=fault,
            between=() if departure is None else tuple(self._between(departure)),
            ended=ended,
            excused=cause in EXCUSES or bool(begun_by),
            bound=bound,
            outcome=outcome,
            why=why,
            begun_by=begun_by,
            prolonged_by=prolonged_by,
        )

    def _begun_by(self, departure: Moment | None) -> str:
        """The forged message that began a hazard; empty if there is none.

        Because of it the prescriber acts, or the target leaves, or the target has another lease.
        """
        world, start = self._world, self._acts.start
        found = world.forged(self._station, start.at)
        if departure is not None and not found:
            found = world.forged(self._target, departure.at)
        if departure is not None and not found and departure.cause == "expire lease":
            about = self._target, self._session, start.proposal
            received = world.messages("Prescription", Receive)
            first = next((at for s, at, _, *named in received if (s, *named) == about), -1)
            found = world.forged(self._target, first)
        return found

    def _prolonged(self) -> str:
        """The forged CAM without which the prescriber would have detected CAM loss before it left.

        Empty if there is none, or if the header lacks t_cam_loss.
        """
        loss, start = self._known.get("t_cam_loss"), self._acts.start
        last_cam_ms, forged = start.t_ms, ""
        cams = [(m.at, m.t_ms) for m in self._cams()]
        for at, t_ms in [*cams, (-1, self._until_ms)]:
            if 0 <= at <= start.at:
                continue
            if found := self._world.forged(self._station, at):
                forged = found
                continue
            if forged and loss is not None and t_ms - last_cam_ms > loss:
                return forged
            last_cam_ms, forged = t_ms, ""
        return ""

    def _outcome(
        self, length: Span | None, bound: Bound | None, forged: bool
    ) -> tuple[Literal["within", "exceeds", "cannot_tell"], str]:
        if bound is None:
            return "cannot_tell", "`parameters` in the header lacks t_cam_loss"
        if length is None:
            return "cannot_tell", "the clocks of the two stations cannot be compared"
        if length.low > bound.ms:
            if forged:
                return "cannot_tell", "T-2 assumes that no message is forged"
            delay = self._world.log(self._station).header.longest_delay
            slow = self._world.slowest(self._target, self._station)
            if slow > delay:
                text = f"T-2 assumes delays of at most {delay} ms; a copy took {slow} ms"
                return "cannot_tell", text
            return "exceeds", ""
        if length.high <= bound.ms:
            return "within", ""
        return "cannot_tell", "the bound lies within the uncertainty of the clocks"

    def _bound(self) -> Bound | None:
        """B = D + t_cam_loss, or the lease if it is shorter, plus the delay of the timer that ended
        the prescriber's part. None if the header lacks t_cam_loss."""
        d = self._world.log(self._station).header.longest_delay
        if (loss := self._known.get("t_cam_loss")) is None:
            return None
        ms, text = d + loss, f"D + t_cam_loss = {d} + {loss}"
        proposal, end = self._acts.start.proposal, self._acts.end
        lease = self._world.leases[self._station].get((self._session, proposal))
        if lease is not None and lease < ms:
            ms, text = lease, f"lease = {lease}"
        late = end.late_ms if end is not None else 0
        if late > 0:
            ms, text = ms + late, f"{text}, and the timer {late} late"
        return Bound(ms, f"{text}: {ms} ms")

    def _between(self, departure: Moment) -> Iterator[str]:
        """The fate of the messages that could have shortened the hazard."""
        world, station, target = self._world, self._station, self._target
        log, cams = world.log(station), self._cams()
        if departure.cause == "expire cam":
            ms = world.log(target).header.known.get("t_cam_loss") or DEFAULTS["t_cam_loss"]
            ahead = world.elapsed(target, departure.t_ms - ms, station, 0)
            if ahead is not None:
                first, to = (
                    bisect_left(log.events, t - ahead.best, key=lambda entry: entry[1].t_ms)
                    for t in (0, ms)
                )
                when = f" in the {ms} ms before"
                yield _count(world, station, target, first, to - 1, "CAM", when)
        if departure.cause != "stopped":
            when = " from then on"
            yield _count(world, target, station, departure.at, None, "Cancel", when)
        if cams:
            yield f"the last CAM that counted was at {self._own.where(cams[-1])}"
        else:
            yield f"no CAM of station {target} counted"

    def _cams(self) -> list[Moment]:
        """The CAMs of the target that counted in the session (ACT-5)."""
        inside = (m for m in self._own.moments if m.session == self._session)
        return [m for m in inside if m.cause == "receive CAM"]


def _count(
    world: World, src: int, dst: int, first: int, last: int | None, type_: str, when: str
) -> str:
    merged, way = world.merged, (world.merged.place(src), dst)
    n = Counter(
        outcome
        for (i, k), to, outcome in outcomes(merged)
        if (i, to) == way and first <= k and (last is None or k <= last)
        if merged.message((i, k))["type"] == type_
    )
    sent = sum(n.values())
    arrived = n["delivered"] + n["duplicated"]
    return f"{sent} {type_}s of {src} to {dst}{when}: {arrived} arrived"
