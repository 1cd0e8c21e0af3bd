"""Checks the system properties (docs/protocol.md, section 7) on the logs of one run.

Logs may each be allowed and still show a hazard together, caused by a fault: S-5 excuses it, T-2
bounds it. ``judge`` reports its cause, its times and its bound.

S-1, S-2 and S-7 concern one station. The specification guarantees them, so an allowed log satisfies
them, and a diverging log is checked up to the divergence. The other properties need the logs of two
stations. A property that the logs do not determine is reported as ``cannot tell``, with the reason.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from itertools import chain, combinations, groupby, pairwise, product
from typing import Literal

from automcm_spec.log_format.event_text import plain
from automcm_spec.log_format.reader import Log
from automcm_spec.support.bad_input import printable
from automcm_traces.system import duration_properties
from automcm_traces.system.delivery import counts, forged
from automcm_traces.system.duration_properties import Checked
from automcm_traces.system.hazards import CannotJudge, Hazard, hazard
from automcm_traces.system.log_merge import Merged, MergeError, merge
from automcm_traces.system.timeline import Moment, Period, Session, Timeline
from automcm_traces.system.world import World

Outcome = Literal["holds", "violated", "cannot_tell"]
NAMES = {
    "S-1": "one session at a time",
    "S-2": "a commitment is never replaced",
    "S-3": "a prescriber acts on a proposal that its target accepted",
    "S-4": "two stations that act in one session have the same proposal",
    "S-5": "no hazard without excuse",
    "S-6": "every acknowledged message was received",
    "S-7": "no effect across sessions",
    "S-8": "one prescriber acts on a receiver's Acceptance",
    "T-1": "a session ends in time",
    "T-2": "a hazard ends in time",
    "T-3": "a message is sent at most N times",
    "T-4": "the prescriber's lease ends first",
    "T-5": "no session is forgotten too early",
}
ENDS = ("restart", "command abort", "expire cam", "expire lease")
"""The causes that may end a commitment, besides a Fin or Cancel of its session (S-2)."""
PAST = {"send": "sent", "receive": "received"}
SAME_TIME = "the clocks do not determine whether at the same time"


@dataclass(frozen=True, slots=True)
class PropertyResult:
    """The outcome for one property: how often it was checked, and where it was violated or
    undecided."""

    property: str
    outcome: Outcome
    checked: int
    where: tuple[str, ...] = ()

    def text(self) -> str:
        """The outcome as text, with the places."""
        word = {"holds": "holds", "violated": "VIOLATED", "cannot_tell": "cannot tell"}
        lines = [f"{self.property} {word[self.outcome]}: {NAMES[self.property]}"]
        return "\n".join(map(printable, [*lines, *(f"  {where}" for where in self.where)]))


@dataclass(frozen=True, slots=True)
class Stay:
    """A period of a station in a session."""

    session: Session
    period: Period
    file: str
    ended: str
    """How it ended, as text."""

    def text(self, start_ms: int = 0) -> str:
        """One line. ``start_ms`` is the time that counts as 0."""
        start, end = self.period.start, self.period.end
        text = f"{plain(self.session)}: station {self.period.station} as {start.role}"
        text = f"{text} from {self.file}:{start.line} ({start.t_ms - start_ms} ms)"
        if end is not None:
            text = f"{text} to {self.file}:{end.line} ({end.t_ms - start_ms} ms)"
        return f"{text}, {self.ended}"


@dataclass(frozen=True, slots=True)
class SystemReport:
    """The result for all logs of one run together."""

    run: str = ""
    files: tuple[str, ...] = ()
    problem: str = ""
    """Why the logs cannot be checked together; then all other fields are empty."""
    properties: tuple[PropertyResult, ...] = ()
    hazards: tuple[Hazard, ...] = ()
    forged: tuple[str, ...] = ()
    cycles: tuple[str, ...] = ()
    sessions: tuple[Stay, ...] = ()
    deliveries: dict[str, dict[str, int]] = field(default_factory=dict)
    notices: tuple[str, ...] = ()

    @property
    def verdict(self) -> Literal["allowed", "hazard", "violated", "cannot_tell"]:
        """The worst outcome; ``hazard`` means an allowed hazard, caused by a fault and within its
        bound."""
        outcomes = {j.outcome for j in self.properties}
        if "violated" in outcomes or self.forged or self.cycles:
            return "violated"
        if self.hazards:
            return "hazard"
        return "cannot_tell" if self.problem or "cannot_tell" in outcomes else "allowed"

    def as_dict(self) -> dict[str, object]:
        """The ``--json`` form."""
        found: dict[str, object] = {"verdict": self.verdict}
        found |= {each.name: getattr(self, each.name) for each in fields(self)}
        found["properties"] = [asdict(j) for j in self.properties]
        found["hazards"] = [h.as_dict() for h in self.hazards]
        found["sessions"] = [stay.text() for stay in self.sessions]
        return found

    def text(self, start_ms: Mapping[str, int] | None = None, matrix: bool = False) -> str:
        """The report as text: the finding at the end, the properties that hold on one line.

        ``start_ms`` has the time that counts as 0, by file. With ``matrix``, the number of messages
        between each two stations, by fate.
        """
        if self.problem:
            return printable(f"together: CANNOT TELL: {self.problem}")
        word = {
            "allowed": "ALLOWED",
            "hazard": "ALLOWED, shows a hazard (fault)",
            "violated": "VIOLATED",
            "cannot_tell": "CANNOT TELL",
        }[self.verdict]
        zero = start_ms or {}
        lines = [f"session {stay.text(zero.get(stay.file, 0))}" for stay in self.sessions]
        for way, found in self.deliveries.items() if matrix else ():
            texts = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in found.items())
            lines.append(f"messages {way}: {texts}")
        lines += [f"note: {notice}" for notice in self.notices]
        held = [j.property for j in self.properties if j.outcome == "holds"]
        lines += [f"hold: {', '.join(held)}"] if held else []
        undecided: dict[tuple[str, ...], list[str]] = {}
        for j in self.properties:
            if j.outcome == "cannot_tell":
                undecided.setdefault(j.where, []).append(j.property)
        for where, names in undecided.items():
            lines.append(f"cannot tell: {', '.join(names)}: {'; '.join(where)}")
        lines += [f"together, run {self.run}: {word}", *self.forged, *self.cycles]
        lines = [printable(line) for line in lines]
        lines += [j.text() for j in self.properties if j.outcome == "violated"]
        return "\n".join([*lines, *(h.text(zero) for h in self.hazards)])


def judge(logs: Sequence[Log]) -> SystemReport:
    """The report on the logs of one run; there is one for any logs."""
    try:
        return judge_merged(merge(logs))
    except MergeError as error:
        return SystemReport(files=tuple(log.file for log in logs), problem=str(error))


def judge_merged(merged: Merged, timelines: Mapping[str, Timeline] | None = None) -> SystemReport:
    """``judge`` for merged logs; ``timelines`` are those already known, by file."""
    world = World(merged, timelines)
    lines = list(world.timelines.values())
    partly = [f"nothing after {t.why}" for t in lines if t.ending in ("diverges", "cannot_tell")]
    no_hazard, bounds, hazards = _hazards(world)
    judged = [
        _result("S-1", one_session(lines), partly),
        _result("S-2", commitment(lines), partly),
        _result("S-3", accepted(world), partly),
        _result("S-4", agreement(world), partly),
        _result("S-5", no_hazard, partly),
        _result("S-6", acknowledged(world), partly),
        _result("S-7", no_cross_effect(lines), partly),
        _result("S-8", exclusive(world), partly),
        _result("T-1", duration_properties.durations(world), partly),
        _result("T-2", bounds, partly),
        _result("T-3", chain(*map(duration_properties.sendings, merged.logs)), []),
        _result("T-4", duration_properties.leases(world), partly),
        _result("T-5", duration_properties.orders(world), partly),
    ]
    return SystemReport(
        world.merged.run,
        tuple(log.file for log in world.merged.logs),
        "",
        tuple(judged),
        tuple(hazards),
        forged(merged),
        tuple(world.merged.cycles),
        tuple(_sessions(world)),
        counts(merged),
        (*world.merged.notices, *world.clocks.notices, *_unequal(world)),
    )


def _unequal(world: World) -> Iterator[str]:
    """A notice for each parameter that differs between stations, although the bounds assume it
    equal."""
    headers = [log.header for log in world.merged.logs]
    for name in ("t_advertise", "t_giveup", "t_life", "t_cam_loss", "t_resend", "max_rounds"):
        values = {h.station: h.known.get(name) for h in headers}
        if len(set(values.values()) - {None}) > 1:
            texts = ", ".join(f"{value} at {station}" for station, value in values.items())
            yield f"{name} differs ({texts}); the bounds assume equal parameters"


def _result(name: str, found: Iterable[Checked], partly: Sequence[str]) -> PropertyResult:
    answers = list(found)
    bad = tuple(text for holds, text in answers if holds is False)
    open_ = tuple(text for holds, text in answers if holds is None)
    if bad:
        return PropertyResult(name, "violated", len(answers), bad)
    if open_ or partly:
        return PropertyResult(
            name, "cannot_tell", len(answers), tuple(dict.fromkeys((*open_, *partly)))
        )
    return PropertyResult(name, "holds", len(answers))


def _sessions(world: World) -> list[Stay]:
    """The periods of all stations in a session, by session and station."""
    stays = []
    for station, line in world.timelines.items():
        for period in line.sessions():
            assert period.session is not None
            ended = f"not ended: {line.why}"
            if (end := period.end) is not None:
                ended = f"{end.cause} by {end.rule}{world.told(station, end)}"
            stays.append(Stay(period.session, period, line.file, ended))
    return sorted(stays, key=lambda stay: (stay.session, stay.period.station))


def _pairs(lines: Iterable[Timeline]) -> Iterator[tuple[Timeline, Moment, Moment]]:
    for line in lines:
        for a, b in pairwise(line.moments):
            yield line, a, b


def one_session(lines: Iterable[Timeline]) -> Iterator[Checked]:
    """S-1: a station changes from one session to another only through STANDALONE."""
    for line, a, b in _pairs(lines):
        if a.session is not None and b.session is not None:
            text = f"from session {plain(a.session)} to {plain(b.session)} at {b.cause}"
            yield a.session == b.session, f"{line.where(b)}: {text}"


def commitment(lines: Iterable[Timeline]) -> Iterator[Checked]:
    """S-2: a commitment is not replaced, and ends only by an allowed cause."""
    for line, a, b in _pairs(lines):
        if (a.phase, a.role) != ("ACTUATING", "receiver"):
            continue
        kept = a.shape == b.shape
        over = b.cause in ("receive Fin", "receive Cancel") and b.about == a.session
        over = over and a.session is not None and b.src == a.session[0]
        left = b.phase == "STANDALONE" and (over or b.cause in ENDS)
        text = f"the commitment to {plain(a.session)} ends by {b.cause}"
        yield kept or left, f"{line.where(b)}: {text}"


def no_cross_effect(lines: Iterable[Timeline]) -> Iterator[Checked]:
    """S-7: a message of another session does not change the own session (END-4)."""
    for line, a, b in _pairs(lines):
        foreign = a.session is not None and b.about is not None and b.about != a.session
        if foreign and b.cause.startswith("receive"):
            text = f"{b.cause} of session {plain(b.about)} has an effect"
            yield a.own == b.own, f"{line.where(b)}: {text}"


def accepted(world: World) -> Iterator[Checked]:
    """S-3: a prescriber acts on an Acceptance of its session and proposal that its target sent."""
    for station, line in world.timelines.items():
        for acts in line.periods("ACTUATING", "prescriber"):
            target = acts.start.target
            assert acts.session is not None, "a station that acts is bound"
            at = world.acceptances.get((target, station, acts.session, acts.start.proposal))
            early = f"acts before station {target} accepts"
            never = f"acts on an Acceptance that station {target} never sent"
            fault = never if at is None else early
            yield _logged_before(world, station, acts.start, target, at, "send", fault)


def _logged_before(
    world: World, station: int, m: Moment, other: int, at: int | None, kind: str, fault: str
) -> Checked:
    """Whether another station has sent or received a message before a moment: the event ``at``."""
    where = world.timelines[station].where(m)
    if other not in world.timelines:
        return None, f"{where}: no log of station {other}"
    if at is not None:
        return not world.before(station, m.at, other, at), f"{where}: {fault}"
    log = world.log(other)
    if kind not in log.header.complete or not log.ended:
        return None, f"{where}: {log.file} may lack messages that station {other} {PAST[kind]}"
    return False, f"{where}: {fault}"


def agreement(world: World) -> Iterator[Checked]:
    """S-4: two stations that act in one session are its prescriber and its target, with one
    proposal."""
    periods = [
        period
        for line in world.timelines.values()
        for role in ("prescriber", "receiver")
        for period in line.periods("ACTUATING", role)
    ]
    periods.sort(key=lambda period: period.session or (0, 0))
    alike = (list(group) for _, group in groupby(periods, key=lambda period: period.session))
    for a, b in (pair for group in alike for pair in combinations(group, 2)):
        if a.station == b.station:
            continue
        one, other = sorted((a, b), key=lambda period: period.start.role)
        roles = (one.start.role, other.start.role) == ("prescriber", "receiver")
        agree = roles and one.start.target == other.station
        if agree and one.start.proposal == other.start.proposal:
            yield True, ""
            continue
        apart = world.apart(a, b)
        where = world.timelines[a.station].where(a.start)
        text = f"{where}: acts in {plain(a.session)} with proposal {a.start.proposal}, and so does"
        text = f"{text} station {b.station} as {b.start.role} with proposal {b.start.proposal}"
        yield apart, text if apart is False else f"{text}; {SAME_TIME}"


def exclusive(world: World) -> Iterator[Checked]:
    """S-8: two prescribers do not act on Acceptances of one receiver, and it does not act as a
    prescriber."""
    acts = [list(line.periods("ACTUATING", "prescriber")) for line in world.timelines.values()]
    for a, b in chain.from_iterable(product(*pair) for pair in combinations(acts, 2)):
        if a.start.target not in (b.start.target, b.station) and b.start.target != a.station:
            continue
        where = world.timelines[a.station].where(a.start)
        text = f"{where}: acts on an Acceptance of station {a.start.target}, and station"
        text = f"{text} {b.station} acts on one of station {b.start.target}"
        apart = world.apart(a, b)
        yield apart, text if apart is False else f"{text}; {SAME_TIME}"


def acknowledged(world: World) -> Iterator[Checked]:
    """S-6: a message that an Ack removes from an outbox was received by its addressee."""
    for station, line in world.timelines.items():
        for moment in line.moments:
            for to, key in moment.acked:
                at = world.received.get((to, station, key))
                when = "but was never received" if at is None else "before it is received"
                fault = f"{key} is acknowledged {when}"
                yield _logged_before(world, station, moment, to, at, "receive", fault)


def _hazards(world: World) -> tuple[list[Checked], list[Checked], list[Hazard]]:
    """The outcomes of S-5 and T-2 for each period in which a prescriber acts, and the hazards."""
    excused: list[Checked] = []
    bounded: list[Checked] = []
    hazards: list[Hazard] = []
    for line in world.timelines.values():
        for acts in line.periods("ACTUATING", "prescriber"):
            where = line.where(acts.start)
            try:
                found = hazard(world, acts)
            except CannotJudge as error:
                excused.append((None, f"{where}: {error}"))
                bounded.append((None, f"{where}: {error}"))
                continue
            if found is None:
                excused.append((True, where))
                continue
            hazards.append(found)
            excused.append((found.excused, f"{found.since}: {found.fault}"))
            kept = {"within": True, "exceeds": False, "cannot_tell": None}[found.outcome]
            bound = found.bound.text if found.bound else "no bound known"
            bounded.append((kept, f"{found.since}: {found.length}, bound {bound} {found.why}"))
    return excused, bounded, hazards
