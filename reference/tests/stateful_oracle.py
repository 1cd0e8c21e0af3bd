"""What the stateful tests run with, what a run has met, and the oracle in lockstep."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import automcm.logging
from automcm.messages import (
    Cam,
)
from automcm.outcome import Row
from automcm.parameters import Parameters
from automcm.phases import WAYS
from automcm.rules import RULES
from automcm.state import State, key
from automcm.station import Effects, Station
from automcm_spec.rules import RULES as EVERY_RULE
from automcm_traces import asking
from automcm_traces.graph_engine import GraphEngine
from automcm_traces.log import RECORD, Header
from automcm_traces.reader import Log
from automcm_traces.step import Diverges
from automcm_traces.track import Track

IDS = (1001, 2002, 3003, 4004)
LEASES = (2500, 700, 120)
"""Longer than t_cam_loss, shorter than it, and over before anybody can answer twice."""
PROPERTIES = ("S-1", "S-2", "S-3", "S-4", "S-5", "S-6", "S-7", "T-1", "T-2", "T-3")
ALL = frozenset({*PROPERTIES, "MEM-1", "oracle"})
UNUSED_SEQ = 900
"""Higher than any seq that a station gets to."""


@dataclass(frozen=True, slots=True)
class Setup:
    """How many stations there are, and their parameters."""

    stations: int
    parameters: Parameters


def _short(**more: int) -> Parameters:
    """Three sendings of each message; N · t_resend = 300 ms."""
    usual = {"t_timeout": 200, "t_decide": 150, "t_cam_loss": 1100}
    return Parameters(**{**usual, "backoff_min": 100, "backoff_max": 400, **more})


SETUPS = (
    Setup(3, _short(max_rounds=3)),
    Setup(4, _short(max_rounds=2)),
    Setup(3, _short(max_rounds=1, max_participants=1, outbox_limit=3, memory_limit=1)),
)
TIGHT = 2
"""The setup in which MEM-1 binds."""


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
    asked: set[tuple[str, int, int]] = field(default_factory=set)
    """Transitions of the oracle's graphs that were taken."""
    cannot_tell: Counter[str] = field(default_factory=Counter)

    def add(self, other: Coverage) -> None:
        self.steps += other.steps
        for name in ("inputs", "phases", "rows", "ways", "looked", "cannot_tell"):
            getattr(self, name).update(getattr(other, name))
        self.asked |= other.asked

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
        one, two = (asking.oracle(n) for n in (False, True))
        met = Counter(name for name, _, _ in self.asked)
        graphs = ", ".join(
            f"{oracle.name} {met[oracle.name]} of {oracle.transitions}" for oracle in (one, two)
        )
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
                f"transitions of the oracle: {graphs}",
                f"could not be told: {dict(self.cannot_tell) or 'nothing'}",
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


# -- the oracle


class Lockstep:
    """The log of one station, not written but fed to the engine that judges logs."""

    def __init__(self, station: Station, coverage: Coverage) -> None:
        fields = {
            "rec": "header",
            "schema": "automcm.trace/1",
            "run": "stateful",
            "station": station.station_id,
            "implementation": {"name": "automcm", "version": "0"},
            "parameters": automcm.logging.parameters(station.parameters),
            "complete": automcm.logging.COMPLETE,
        }
        header = RECORD.validate_python(fields)
        assert isinstance(header, Header)
        self.engine = GraphEngine(Log("memory", header, [], None, False, []))
        self._station, self._coverage = station, coverage
        self._seq = 0

    def event(self, ev: str, t_ms: int, /, **fields: object) -> int:
        """As LogWriter.event, which automcm.logging calls."""
        self._seq += 1
        observed = {name: value for name, value in fields.items() if value is not None}
        record = {"rec": "event", "seq": self._seq, "t_ms": t_ms, "ev": ev, **observed}
        event: Any = RECORD.validate_python(record)
        self.engine.feed(self._seq, event)
        return self._seq

    def took(self, effects: Effects, raw: bytes, last: bool) -> None:
        """One input and its effects.  ``last``: of this instant."""
        engine = self.engine
        txs = [f"{self._station.station_id}:{self._seq + n}" for n in range(len(effects.messages))]
        try:
            log: Any = self
            automcm.logging.write(log, effects, txs, raw=raw)
            step = engine._step
            if step is not None:
                self._compare_rule(effects, step)
            engine.finish()
        except Diverges as d:
            wanted = "; ".join(d.wanted)
            raise broken(
                f"oracle {d.rule or 'none'}", f"{d.event}; expected: {wanted} ({d.guard})"
            ) from None
        self._compare_state(effects.state, last)

    def sent_cam(self, cam: Cam, now: int) -> None:
        """ACT-5: the marks are what the oracle says."""
        try:
            self.event("send", now, tx="1:1", message=automcm.messages.to_dict(cam))
        except Diverges as d:
            raise broken(f"oracle {d.rule}", f"{d.event}; expected: {d.wanted}") from None

    def _compare_rule(self, effects: Effects, step: Any) -> None:
        if step.rule != effects.rule:
            raise broken(f"oracle {step.rule}", f"{step.what}: decided by {effects.rule}")
        answer = step.found.answer
        if answer.changes:
            name = "two-peers" if len(step.found.view.ids) > 2 else "one-peer"
            self._coverage.asked.add((name, answer.state, answer.input))

    def _compare_state(self, state: State, last: bool) -> None:
        """What the log says of the station is what the station is."""
        track, known = _known(self.engine.track), _known(state)
        for name in track:
            if track[name] != known[name]:
                raise broken(
                    "oracle state", f"{name} is {known[name]}, and by the log {track[name]}"
                )
        deadlines = sorted(self._station.timers.values())
        if last and sorted(d.first for d in self.engine.timers.values()) != deadlines:
            raise broken("oracle timers", f"{self._station.timers}; log: {self.engine.timers}")


def _known(of: Track | State) -> dict[str, Any]:
    """The fields of Station.tla, for comparison."""
    entries: Iterable[tuple[Any, ...]]
    if isinstance(of, Track):
        entries = ((e.type, e.to, e.session, e.message["seq"]) for e in of.outbox)
    else:
        entries = (tuple(key(m)) for m in of.outbox)
    return {
        "phase": of.phase,
        "role": of.role,
        "session": of.session,
        "recorded": set(of.recorded),
        "withdrawn": set(of.withdrawn),
        "target": of.target,
        "proposal": of.proposal,
        "deciding": of.deciding,
        "heard": of.heard_ms,
        "number": of.number,
        "joined": dict(of.joined),
        "outbox": set(entries),
        "quarantine": of.quarantine,
        "backoff": of.backoff,
    }
