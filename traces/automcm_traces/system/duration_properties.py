"""Checks T-1, T-3, T-4 and T-5 on the logs of a run (docs/verification.md, section 2).

A timer that expires late lengthens what it ends. So the bound of T-1 grows by the delays of the
session's timers.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator
from itertools import chain

from automcm_spec.log_format.event_text import plain
from automcm_spec.log_format.log import Send, TimerArm, TimerEnd
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary.messages import RELIABLE
from automcm_spec.vocabulary.parameters import DEFAULTS, longest_session
from automcm_traces.system.timeline import Moment, Period, Session, Timeline, key_of
from automcm_traces.system.world import World

Checked = tuple[bool | None, str]
"""Whether the property holds (None: cannot tell), and where or why not."""


def durations(world: World) -> Iterator[Checked]:
    """T-1: each session that begins in a log lasts at most as long as its bound."""
    for station, line in world.timelines.items():
        p = {"max_rounds": DEFAULTS["max_rounds"]} | world.log(station).header.known
        longest: dict[Session, int] = {}
        for (session, _), lease in world.leases[station].items():
            longest[session] = max(lease, longest.get(session, 0))
        for period in line.sessions():
            end = line.last[2] if period.end is None else period.end.t_ms
            lasted = end - period.start.t_ms
            lease, where = longest.get(period.session or (0, 0), 0), line.where(period.start)
            try:
                bound = longest_session(p, period.start.role, lease)
            except KeyError:
                yield None, f"{where}: `parameters` in the header lacks a duration"
                continue
            first = bisect_right(line.moments, period.start.at, key=lambda m: m.at)
            late = 0
            for n in range(first, len(line.moments)):
                if period.end is not None and line.moments[n].at > period.end.at:
                    break
                late += max(0, line.moments[n].late_ms)
            text = f"{where}: in a session for {lasted} ms, at most {bound}"
            yield lasted <= bound + late, text + (f", and timers {late} ms late" if late else "")


def sendings(log: Log) -> Iterator[Checked]:
    """T-3: the resend timer sends a reliable message at most N times."""
    giveup, resend = map(log.header.known.get, ("t_giveup", "t_resend"))
    if giveup is None or not resend:
        yield None, f"{log.file}: `parameters` in the header lacks t_giveup or t_resend"
        return
    most, timed = giveup // resend, False
    count: Counter[str] = Counter()
    for line, e in log.events:
        if not isinstance(e, Send):
            if e.is_input:
                timed = isinstance(e, TimerEnd) and e.timer.name == "resend"
            continue
        m = e.message
        if m["type"] not in RELIABLE or not m.get("seq"):
            continue
        key = key_of(m)
        if timed or key not in count:
            count[key] += 1
            yield count[key] <= most, f"{log.file}:{line}: {key}, sent {count[key]} times of {most}"


def leases(world: World) -> Iterator[Checked]:
    """T-4: the lease of an acting prescriber does not outlive that of its target."""
    for line in world.timelines.values():
        for acts in line.periods("ACTUATING", "prescriber"):
            target = acts.start.target
            if target not in world.timelines:
                yield None, f"{line.where(acts.start)}: no log of station {target}"
                continue
            for held in world.committed(target, acts.session, acts.start.proposal):
                yield _lease(world, acts, held)


def _lease(world: World, acts: Period, held: Period) -> Checked:
    own, other = (_armed(world.log(s.station), s.start.at) for s in (acts, held))
    where = world.timelines[acts.station].where(acts.start)
    if own is None or other is None:
        return None, f"{where}: no lease timer in the logs"
    (at, armed_ms, deadline), (at_other, armed_other, deadline_other) = own, other
    same = deadline - armed_ms <= deadline_other - armed_other
    if same and world.before(acts.station, at, held.station, at_other):
        return True, where
    gap = world.elapsed(held.station, deadline_other, acts.station, deadline)
    if gap is None or gap.low <= 0 < gap.high:
        return None, f"{where}: the clocks do not determine whose lease ends first"
    return gap.high <= 0, f"{where}: its lease outlives that of station {held.station} by {gap}"


def _armed(log: Log, at: int) -> tuple[int, int, int] | None:
    """The lease timer that runs after the step of an event: the event and time of arming, and the
    deadline."""
    last = at
    while last + 1 < len(log.events) and not log.events[last + 1][1].is_input:
        last += 1
    for k in range(last, -1, -1):
        e = log.events[k][1]
        if isinstance(e, TimerArm) and e.timer.name == "lease":
            return k, e.t_ms, e.deadline
    return None


def orders(world: World) -> Iterator[Checked]:
    """T-5: when a station forgets a session or its quarantine ends, nobody advertises a session
    that the station was in, and no message to its prescriber is left to be sent.

    Copies of Advertisements that are still on the way are not checked.
    """
    for line in world.timelines.values():
        been: set[Session] = set()
        for m in line.moments:
            if m.session is not None:
                been.add(m.session)
            if m.cause not in ("expire forget", "expire quarantine"):
                continue
            whose = None if m.cause == "expire quarantine" else m.forgot
            known = {s for s in been if whose in (None, s[0])}
            if m.left:
                text = f"a message of a session of station {m.forgot} is still being sent"
                yield False, f"{line.where(m)}: {text}"
            yield _forgets(world, line, m, known)


def _forgets(world: World, line: Timeline, m: Moment, known: set[Session]) -> Checked:
    where = line.where(m)
    for p in sorted({p for p, _ in known}):
        if p == line.station:
            continue
        if p not in world.timelines:
            return None, f"{where}: no log of station {p}"
        advertised = world.periods(p, "ADVERTISING", "prescriber")
        for period in chain.from_iterable(advertised[s] for s in advertised if s in known):
            begun = world.elapsed(p, period.start.t_ms, line.station, m.t_ms)
            last = world.timelines[p].last[2] if period.end is None else period.end.t_ms
            over = world.elapsed(p, last, line.station, m.t_ms)
            if begun is None or over is None:
                return None, f"{where}: the clocks of {p} and {line.station} cannot be compared"
            text = f"{where}: station {p} still advertises {plain(period.session)}"
            if begun.low > 0 and over.high < 0:
                return False, text
            if period.end is None and over.high >= 0:
                return None, f"{text} where its log ends"
    return True, where
