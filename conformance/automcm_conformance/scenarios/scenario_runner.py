"""Runs one play: several stations, their applications and a radio, in virtual time.

Every step of every station is followed on the specification (monitor.py).  Three things remain to
be checked: sessions that do not end (L-1), the properties of the system (S-*, T-*) on the logs, and
the indications that the applications received.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from automcm_conformance.adapter.process import AdapterError, Process
from automcm_conformance.adapter.protocol import DEFAULTS, HelloAnswer, Object, ProtocolError
from automcm_conformance.exchange.results import Line, Verdict
from automcm_conformance.exchange.wire import HOLD_MS
from automcm_conformance.scenarios.monitor import Monitor
from automcm_conformance.scenarios.scripted_radio import Rule, ScriptedRadio
from automcm_spec.log_format.reader import read
from automcm_spec.vocabulary.parameters import derived, durations
from automcm_spec.vocabulary.station import Input
from automcm_traces.checker.finding import NOTHING_WRONG, Diverges, Finding, Where
from automcm_traces.checker.track import CannotTell
from automcm_traces.system.properties import judge

START_MS = 1_000
LEASE_MS = 20_000
SHOWN = 60
"""An outcome has this many of the last lines; the logs have all."""
IDLE_PERIODS = 3
"""A play ends after this many periods of t_cam in which all stations are idle."""


@dataclass(frozen=True, slots=True)
class When:
    """An action that the application takes ``after_ms`` after each ``event``.

    ``event``: a phase that the station enters, an indication, ``start`` or ``restart``.
    ``action``: ``request``, ``complete``, ``abort`` or ``restart`` (loss of power).  ``complete``
    and ``abort`` are left out if the session has changed.  ``times`` limits the number of actions.
    """

    event: str
    after_ms: int
    action: str
    times: int = 1_000


@dataclass(frozen=True, slots=True)
class ScriptedDriver:
    """The behaviour of one station's application."""

    actions: tuple[When, ...] = ()
    joins: bool = False
    """Whether every Advertisement concerns it."""
    target: int = 0
    """The station that it chooses; 0 means the lowest id recorded."""
    refuses: int = 0
    """How many proposals of a session it refuses before it accepts."""
    thinks_ms: int = 20
    """Time from choose, verify or propose to the command that answers it; at most t_decide / 2."""
    lease_ms: int = LEASE_MS


@dataclass(frozen=True, slots=True)
class Play:
    """Stations on a radio; no lease is longer than LEASE_MS.

    ``expected`` are the indications that the application of a station must have received at the
    end, by name and in order.  ``fallback`` may have its reason appended.
    """

    stations: Mapping[int, ScriptedDriver]
    radio: tuple[Rule, ...] = ()
    expected: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    seeds: int = 1
    """How often the play is run, each time with another seed."""


@dataclass(frozen=True, slots=True)
class ScenarioOutcome:
    """The outcome of a scenario."""

    verdict: Verdict
    reason: str = ""
    """One line: why the verdict is neither PASS nor FAIL, or which plays of a PASS were skipped."""
    finding: Finding = NOTHING_WRONG
    """The divergence of the station ``at.file``, or the broken property: S-*, T-* or L-1."""
    input: Input | None = None
    """The input that the rule decides."""
    came: list[str] = field(default_factory=list)
    """The station's last answer, or the last lines of standard error."""
    lines: list[Line] = field(default_factory=list)
    """The last lines of the first play that did not pass."""
    log: list[str] = field(default_factory=list)
    """The logs of all stations relative to the folder; only those of a play that did not pass."""


class PlayRun:
    """Runs one play.  The same ``seed`` gives the same bytes.

    A queue holds the deliveries and the actions of the applications; at the same time, deadlines of
    the stations come first.  Logs are written to ``folder``, which must exist.
    """

    def __init__(
        self,
        play: Play,
        processes: Mapping[int, Process],
        hello: HelloAnswer,
        folder: Path,
        seed: int,
    ) -> None:
        self._play, self._hello, self._seed = play, hello, seed
        self._processes = processes
        self._logs = {station: folder / f"{station}.ndjson" for station in play.stations}
        self._lines: list[Line] = []
        self._stations: dict[int, Monitor] = {}
        self._parameters = hello.fitted(DEFAULTS)
        self._radio = ScriptedRadio(play.radio, self._parameters, seed)
        self._queue: list[tuple[int, int, bool, Callable[[], None]]] = []
        self._order = 0
        self._pending = 0
        """Entries of the queue other than CAMs and the tick."""
        self._idle = 0
        """Periods of t_cam in which all stations were idle."""
        self._now = START_MS
        self._done: dict[tuple[int, int], int] = {}
        self._indications: dict[int, list[str]] = {station: [] for station in play.stations}
        self._at = 0
        """The station that gets the current command."""

    def outcome(self, folder: Path) -> ScenarioOutcome:
        """Run the play and return its outcome.  Logs are named relative to ``folder``.

        Raises OSError.
        """
        outcome = self._played(folder)
        logs = [str(path.relative_to(folder)) for path in self._logs.values() if path.exists()]
        lines = [] if outcome.verdict == "PASS" else self._lines[-SHOWN:]
        return replace(outcome, lines=lines, log=logs)

    def _played(self, folder: Path) -> ScenarioOutcome:
        end = "clean"
        try:
            self._run()
        except Diverges as d:
            return self._not_allowed(d)
        except CannotTell as error:
            return self._inconclusive(f"{self._at}: {error}")
        except (AdapterError, ProtocolError) as error:
            end = "crash"
            came = list(getattr(error, "stderr", ()))
            return ScenarioOutcome("ERROR", f"{self._at}: {error}", came=came)
        finally:
            for monitor in self._stations.values():
                monitor.end(end)
        if (broken := self._broken_property(folder)) is not None:
            return ScenarioOutcome("FAIL", finding=broken)
        for station, expected in self._play.expected.items():
            found = self._indications[station]
            pairs = zip(expected, found, strict=False)
            alike = all(wanted in (told, told.split()[0]) for wanted, told in pairs)
            if len(found) != len(expected) or not alike:
                text = f"every step is allowed, but {station} indicated {', '.join(found)}"
                return self._inconclusive(f"{text}; expected {', '.join(expected)}")
        return ScenarioOutcome("PASS")

    def _inconclusive(self, text: str) -> ScenarioOutcome:
        """Every step is allowed, so parameters that are not the default must be the reason."""
        fixed = [f"{n} {ms}" for n, ms in self._hello.fixed.items() if DEFAULTS[n] != ms]
        if not fixed:
            return ScenarioOutcome("INCONC", text)
        return ScenarioOutcome("SKIP", f"not applicable with {' and '.join(fixed)}: {text}")

    def _not_allowed(self, d: Diverges) -> ScenarioOutcome:
        found = self._stations.get(self._at)
        last = None if found is None else found.last
        return ScenarioOutcome(
            "FAIL",
            finding=replace(d.finding, at=Where(str(self._at), d.finding.at.line)),
            input=last.input if last is not None and d.finding.rule == last.rule else None,
            came=[line.text for line in self._lines[-1:] if line.who == "station"],
        )

    # -- time

    def _run(self) -> None:
        for station in self._play.stations:
            self._at = station
            self._stations[station] = Monitor(
                station,
                self._processes[station],
                self._logs[station],
                self._lines,
                self._hello,
                self._parameters,
                run=self._logs[station].parent.name,
                seed=self._seed * 10_000 + station,
                now=START_MS,
            )
            self._schedule_actions(station, "start")
        self._after(0, self._tick, counts=False)
        known = {**self._parameters, **derived(self._parameters)}
        timers_ms = sum(durations(known)[name] or 0 for name in ("hold", "quarantine", "cam"))
        end = START_MS + 3 * (LEASE_MS + timers_ms)
        while self._idle < IDLE_PERIODS:
            due = [s.deadline for s in self._stations.values() if s.deadline is not None]
            self._now = max(self._now, min([self._queue[0][0], *due]))
            if self._now > end:
                if any(s.track.state.phase != "STANDALONE" for s in self._stations.values()):
                    return
                raise CannotTell(f"messages are still being sent at {self._now} ms")
            for station, monitor in self._stations.items():
                if monitor.deadline is not None and monitor.deadline <= self._now:
                    self._give(station, {"cmd": "advance"})
            while self._queue[0][0] <= self._now:
                _, _, counts, action = heapq.heappop(self._queue)
                self._pending -= counts
                action()

    def _after(self, ms: int, action: Callable[[], None], *, counts: bool = True) -> None:
        self._order += 1
        self._pending += counts
        heapq.heappush(self._queue, (self._now + ms, self._order, counts, action))

    def _tick(self) -> None:
        """Advance all stations every t_cam, so that each sends its CAMs in time."""
        for station in self._stations:
            self._give(station, {"cmd": "advance"})
        idle = all(
            monitor.track.state.phase == "STANDALONE" and not monitor.track.outbox
            for monitor in self._stations.values()
        )
        self._idle = self._idle + 1 if idle and not self._pending else 0
        self._after(self._parameters["t_cam"], self._tick, counts=False)

    def _broken_property(self, folder: Path) -> Finding | None:
        """The first property of the system that does not hold; None if all hold."""
        for station, monitor in self._stations.items():
            if (phase := monitor.track.state.phase) != "STANDALONE":
                text = f"{station} is still in {phase} at {self._now} ms"
                return Finding("property", property="L-1", observed=text)
        system = judge([read(path) for path in self._logs.values()])
        for found in system.properties:
            if found.outcome == "violated":
                text = found.where[0].replace(f"{folder}/", "")
                return Finding("property", property=found.property, observed=text)
        return None

    # -- stations, radio and applications

    def _give(self, station: int, command: Object, tx: str | None = None) -> None:
        """Give a station a command, and handle the messages and indications of its answer."""
        self._at = station
        monitor = self._stations[station]
        phase = monitor.track.state.phase
        monitor.give(self._now, command, tx)
        for own, m in monitor.sent:
            self._send(station, own, m)
        now = monitor.track.state.phase
        if now != phase:
            if now == "ACTUATING" and monitor.track.state.role == "prescriber":
                self._radio.acting_at = self._radio.acting_at or self._now
            self._schedule_actions(station, now)
        for indication in monitor.indications:
            name = indication["name"]
            told = f"{name} {indication['reason']}" if name == "fallback" else name
            self._indications[station].append(told)
            self._schedule_actions(station, name)
            self._respond(station, indication)

    def _send(self, station: int, tx: str, m: Object) -> None:
        for other, application in self._play.stations.items():
            if other == station:
                continue
            command = {"cmd": "receive", "message": m}
            if m["type"] == "Advertisement" and application.joins:
                command["planned"] = _trajectory(other, 0)
            for at in self._radio.arrivals(m, station, other, self._now):
                arrives = partial(self._give, other, command, tx)
                self._after(at - self._now, arrives, counts=m["type"] != "CAM")

    def _respond(self, station: int, indication: Object) -> None:
        """Schedule the command by which an application answers choose, verify or propose."""
        application, name = self._play.stations[station], indication["name"]
        if name not in ("choose", "verify", "propose"):
            return
        session, k = indication["session"], indication.get("proposal", 1)
        command: Object = {"name": "prescribe", "session": session, "proposal": k}
        if name == "verify" and k <= application.refuses:
            command["name"] = "refuse"
        elif name == "verify":
            command |= {"name": "accept", "selected": indication["prescribed"]}
        else:
            target = self._stations[station].track.state.target
            if name == "choose":
                target = application.target or min(indication["stations"], default=0) or station
            command |= {"target": target, "prescribed": _trajectory(session[1], k)}
            command |= {"hold_ms": HOLD_MS, "lease_ms": application.lease_ms}
        thinks = min(application.thinks_ms, self._parameters["t_decide"] // 2)
        self._after(thinks, partial(self._give_if_current, station, command))

    def _schedule_actions(self, station: int, event: str) -> None:
        """Schedule the actions of an application that follow this event."""
        session = self._stations[station].track.session
        for place, when in enumerate(self._play.stations[station].actions):
            done = self._done.get((station, place), 0)
            if when.event != event or done == when.times:
                continue
            self._done[station, place] = done + 1
            if when.action == "restart":
                action = partial(self._restart, station)
            else:
                command: Object = {"name": when.action, "session": list(session or ())}
                if when.action == "request":
                    scenario = self._hello.scenarios[0]
                    command = {"name": "request", "scenario": scenario, "details": {"lane": 2}}
                action = partial(self._give_if_current, station, command)
            self._after(when.after_ms, action)

    def _give_if_current(self, station: int, command: Object) -> None:
        """Give a command, unless its session has ended."""
        session = self._stations[station].track.session
        if command["name"] == "request" or list(session or ()) == command["session"]:
            self._give(station, {"cmd": "command", "command": command})

    def _restart(self, station: int) -> None:
        self._give(station, {"cmd": "restart"})
        self._schedule_actions(station, "restart")


def _trajectory(a: int, b: int) -> Object:
    """A trajectory that contains these two numbers."""
    return {"t0": 0, "points": [[0, 0, 0], [1000, 8000 + b, a]]}
