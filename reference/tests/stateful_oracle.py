"""The setting of the stateful tests, their coverage, and the specification in lockstep."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from automcm.core.outcome import Expiry, Received, ReceivedCam, Restart, Row
from automcm.core.phases import WAYS
from automcm.core.rules import RULES
from automcm.core.state import State, Timer
from automcm.core.station import Effects, Station
from automcm_maintenance.verify.spec_mapping import abstract, abstract_input, answer, is_copy
from automcm_spec.vocabulary import station as specification
from automcm_spec.vocabulary.condition_coverage import ConditionCoverage, lacking, reached
from automcm_spec.vocabulary.conditions import recording
from automcm_spec.vocabulary.messages import Cam, Prescription
from automcm_spec.vocabulary.parameters import Parameters, durations, lease_lasts, rank
from automcm_spec.vocabulary.rules import RULES as EVERY_RULE

IDS = (1001, 22, 303, 4_000_004, 5, 606, 70_007, 88, 2**32 - 1, 909, 10, 12_012)
STRANGER = 404
"""A station that nobody is."""
LEASES = (2500, 700, 120)
"""Longer than t_cam_loss, shorter than it, and over before anybody can answer twice."""
PROPERTIES = ("S-1", "S-2", "S-3", "S-4", "S-5", "S-6", "S-7", "S-8", "T-1", "T-2", "T-3")
ALL = frozenset({*PROPERTIES, "oracle"})
UNUSED_SEQ = 900
"""Higher than any seq that a station gets to."""


@dataclass(frozen=True, slots=True)
class Setup:
    """How many stations there are, and their parameters."""

    stations: int
    parameters: Parameters


def setup(stations: int, rounds: int, participants: int, spare: int, memory: int) -> Setup:
    """Three sendings of each message; N · t_resend = 300 ms.  ``spare``: how many messages the
    outbox may hold when a session begins (MEM-1)."""
    limits = {"max_rounds": rounds, "max_participants": participants, "memory_limit": memory}
    outbox = 1 + max(participants, rounds) + spare
    durations_ms = {"t_timeout": 200, "t_decide": 150, "t_cam_loss": 1100}
    alike = {"clock_drift": 0}  # with a margin, a lease that is counted wrongly shows too rarely
    backoff = {"backoff_min": 100, "backoff_max": 400}
    times = {**durations_ms, **alike, **backoff}
    return Setup(stations, Parameters(**times, **limits, outbox_limit=outbox))


# -- what a run has met


def _rows(rules: dict[str, tuple[Row, ...]]) -> set[tuple[str, int, str]]:
    return {(name, n, row.rule) for name, rows in rules.items() for n, row in enumerate(rows)}


NO_ROW = {"ACT-1", "END-4"}
"""ACT-1 is the application's; END-4 is no row but the guard of many (S-7 is its check)."""


@dataclass(slots=True)
class Coverage:
    """What the machines of a run have met."""

    steps: int = 0
    inputs: Counter[str] = field(default_factory=Counter)
    """By the rule that decided."""
    phases: Counter[tuple[str, str]] = field(default_factory=Counter)
    rows: Counter[tuple[str, int, str]] = field(default_factory=Counter)
    """Rows of the reference's tables that decided: input, place, rule."""
    ways: Counter[tuple[str, str, str, str]] = field(default_factory=Counter)
    looked: Counter[str] = field(default_factory=Counter)
    """How often a property had something to look at."""
    conditions: ConditionCoverage = field(default_factory=ConditionCoverage)
    """Of Station.tla."""

    def add(self, other: Coverage) -> None:
        self.steps += other.steps
        for name in ("inputs", "phases", "rows", "ways", "looked"):
            getattr(self, name).update(getattr(other, name))
        self.conditions.ways.update(other.conditions.ways)

    def rules_and_phases_missing(self) -> list[str]:
        """What even a short run must meet."""
        return [text for text in self.missing() if text.split()[0] in ("rule", "phase", "property")]

    def missing(self) -> list[str]:
        """Rules, phases, ways between phases and rows that were never met."""
        states = {(role, phase) for role, phase, _, _ in WAYS} | {("none", "STANDALONE")}
        states -= {("prescriber", "STANDALONE"), ("receiver", "STANDALONE")}
        out = [f"rule {r}" for r in EVERY_RULE if r not in NO_ROW and not self.inputs[r]]
        out += [f"phase {r} {p}" for r, p in sorted(states) if not self.phases[r, p]]
        out += [f"way {' '.join(way)}" for way in sorted(WAYS) if not self.ways[way]]
        out += [
            f"row {n} of {name}: {r}"
            for name, n, r in sorted(_rows(RULES))
            if not self.rows[name, n, r]
        ]
        out += [f"property {p}: nothing to look at" for p in PROPERTIES if not self.looked[p]]
        return out

    def report(self) -> str:
        """Several lines for a person."""
        rarest = ", ".join(f"{r} {n}" for r, n in sorted(self.inputs.items(), key=_second)[:5])
        looked = ", ".join(f"{name} {self.looked[name]}" for name in sorted(self.looked))
        rules = len([r for r in EVERY_RULE if self.inputs[r]])
        return "\n".join(
            [
                f"{self.steps} steps, {sum(self.inputs.values())} inputs of stations",
                f"rules {rules} of {len(EVERY_RULE) - len(NO_ROW)}, rows "
                f"{len(self.rows)} of {len(_rows(RULES))}, phases {len(self.phases)} of 10, "
                f"ways between phases {len(self.ways)} of {len(WAYS)}",
                f"rarest rules: {rarest}",
                f"looked at: {looked}",
                f"conditions of Station.tla: {self.conditions.both_ways()} of "
                f"{len(reached().conditions)} both ways",
                *(f"  {line}" for line in lacking(self.conditions)),
                "missing: " + ("; ".join(self.missing()) or "nothing"),
            ]
        )


def _second(pair: tuple[Any, int]) -> int:
    return pair[1]


# -- what can go wrong


class Broken(AssertionError):
    """A property, or the oracle's rule, that does not hold.  Each has a class of its own, so
    that hypothesis shrinks one and does not slip to another."""

    what = ""


@cache
def _kind(what: str) -> type[Broken]:
    return type(f"Broken_{what.replace('-', '_')}", (Broken,), {"what": what})


def broken(what: str, text: str) -> Broken:
    """``what`` is the id of the property or rule."""
    return _kind(what)(f"{what}: {text}")


# -- the specification

CONTENT = ("scenario", "details", "planned", "prescribed", "hold_ms", "lease_ms", "selected")
"""Fields of a message that are as the application gave them."""


class Lockstep:
    """The compiled specification is given each input of one station of the reference.

    What the specification leaves out is compared too: content, seq and the deadlines of timers.
    """

    def __init__(self, station: Station, coverage: Coverage) -> None:
        p = station.parameters
        limits = p.max_rounds, p.max_participants, p.outbox_limit, p.memory_limit
        self._specified = recording(specification.Station(*limits), coverage.conditions.meet)
        self._station, self._me = station, station.station_id
        self._state = abstract(station.state)
        self._durations = durations(p.known)
        self._deadlines: dict[Timer, int] = {}
        self._lease_ms = 0

    def took(self, before: State, effects: Effects, last: bool) -> None:
        """One input and its effects.  ``last``: of this instant."""
        if effects.input is None:
            _no_message(before, effects)
            return
        given = effects.input.message if isinstance(effects.input, Received) else None
        i = abstract_input(self._station.me, before, effects.input)
        outcome = self._specified.step(self._me, self._state, i)
        messages, told, arm, stop = answer(before, given, effects)
        done = [abstract(effects.state), messages, told, effects.rule, arm, stop]
        for name, is_, should in zip(outcome._fields, done, outcome, strict=True):
            if isinstance(is_, list):
                is_, should = sorted(is_, key=str), sorted(should, key=str)
            if is_ != should:
                text = f"{i}: {name} is {is_}, by the specification {should}"
                raise broken(f"oracle {outcome.rule}", text)
        self._state = outcome.st
        self._content(before, effects)
        self._timers(effects)
        if last and self._deadlines != self._station.timers:
            text = f"{self._station.timers}, but those armed are {self._deadlines}"
            raise broken("oracle timers", text)

    def sent_cam(self, cam: Cam) -> None:
        """ACT-5: the marks are those of the specification."""
        marks = self._specified.marks(self._state)
        if frozenset(cam.marks) != marks or len(cam.marks) != len(marks):
            raise broken("oracle ACT-5", f"marks {cam.marks}, by the specification {marks}")

    def _content(self, before: State, effects: Effects) -> None:
        i, after = effects.input, effects.state
        new = [m for m in effects.messages if m.seq and not is_copy(before, m)]
        numbers = sorted(m.seq for m in new)
        wanted = [before.seq + n for n in range(1, len(new) + 1)]
        if numbers != wanted:
            raise broken("oracle content", f"{i}: seq {numbers}, not {wanted}")
        for m in new:
            for name in CONTENT:
                if hasattr(m, name) and hasattr(i, name) and getattr(m, name) != getattr(i, name):
                    raise broken("oracle content", f"{i}: {name} of {m}")
        for told in effects.indications:
            if (session := getattr(told, "session", None)) not in (
                None,
                before.session,
                after.session,
            ):
                raise broken("oracle content", f"{i}: {told} of {session}")
        heard_ms = before.heard_ms if after.heard_ms is not None else None
        first = before.first_cam_ms if after.heard_ms is not None else None
        if isinstance(i, ReceivedCam) and effects.armed:
            heard_ms = i.message.generation_ms
            first = first or (heard_ms, effects.now_ms)
        if (after.heard_ms, after.first_cam_ms) != (heard_ms, first):
            raise broken("oracle content", f"{i}: heard at {after.heard_ms}, not {heard_ms} ms")

    def _timers(self, effects: Effects) -> None:
        i, now = effects.input, effects.now_ms
        if isinstance(i, Expiry):
            if (due := self._deadlines[i.timer]) != now:
                raise broken("oracle timers", f"{i.timer} expires at {now}, not at {due} ms")
            first = min(self._deadlines, key=self._turn)
            if self._turn(first) < self._turn(i.timer):
                raise broken("oracle timers", f"{i.timer} expires before {first}")
            del self._deadlines[i.timer]
        if not isinstance(i, Restart) and min(self._deadlines.values(), default=now) < now:
            raise broken("oracle timers", f"{now} ms: overdue in {self._deadlines}")
        verify = any(told.name == "verify" for told in effects.indications)
        heard = [i.message] if isinstance(i, Received) and verify else []
        for m in (*heard, *effects.messages):
            if isinstance(m, Prescription):
                self._lease_ms = m.lease_ms
        for timer in effects.stopped:
            del self._deadlines[timer]
        for timer, deadline in effects.armed:
            self._deadlines[timer] = deadline
            least, most = self._lasts(timer)
            if not least <= deadline - now <= most:
                text = f"{timer} lasts {deadline - now} ms, not {least} to {most} ms"
                raise broken("oracle timers", text)

    def _turn(self, timer: Timer) -> tuple[int, int]:
        """Less for what fires earlier; of several messages any may be the first."""
        advertises = timer.entry is not None and timer.entry.type == "Advertisement"
        return self._deadlines[timer], rank(timer.name, advertises)

    def _lasts(self, timer: Timer) -> tuple[int, int]:
        """The shortest and the longest time that a timer may be armed for, ms."""
        p = self._station.parameters
        if timer.name == "backoff":
            return p.backoff_min, p.backoff_max
        if timer.name == "forget":
            return p.t_life, p.t_advertise + p.t_life
        lasts = self._durations[timer.name]
        if timer.name == "lease":
            lasts = lease_lasts(p.clock_drift, self._station.state.role, self._lease_ms)
        assert lasts is not None
        return lasts, lasts


def _no_message(before: State, effects: Effects) -> None:
    """END-5: of bytes that are no message the application is told, and that is all."""
    told = [indication.name for indication in effects.indications]
    more = effects.messages or effects.armed or effects.stopped
    if more or effects.state is not before or (effects.rule, told) != ("END-5", ["discarded"]):
        raise broken("oracle END-5", f"bytes that are no message: {effects}")
