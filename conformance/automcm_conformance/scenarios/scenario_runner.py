"""Several stations, their applications and a radio, in virtual time: one play, and its outcome.

Every step of every station is followed on the oracle (monitor.py).  That leaves three things to
look at: hazards between the stations (S-4, S-5, S-8), sessions that do not end (L-1), and whether
the play went where it must.  S-1, S-2 and S-3 are about one station, so a step that breaks them is
not allowed.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from automcm_conformance.adapter.connect import Connection
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import DEFAULTS, HelloAnswer, Object, ProtocolError
from automcm_conformance.exchange.results import Line, Verdict
from automcm_conformance.exchange.wire import HOLD_MS
from automcm_conformance.scenarios.monitor import Monitor
from automcm_conformance.scenarios.scripted_radio import Radio, Rule
from automcm_spec.vocabulary.parameters import derived, durations
from automcm_spec.vocabulary.station import Input
from automcm_traces.checker.finding import NOTHING_WRONG, At, Diverges, Finding
from automcm_traces.checker.track import CannotTell, Track

START_MS = 1_000
LEASE_MS = 20_000
SHOWN = 60
"""Lines of an exchange in an outcome; the logs have all."""
CALM = 3
"""Times t_cam for which nothing may happen any more before the end."""


@dataclass(frozen=True, slots=True)
class When:
    """``after_ms`` after each ``event`` there is the ``action``, ``times`` times at most.

    ``event``: a phase that the station enters, an indication, ``start`` or ``restart``.
    ``action``: ``request``, ``complete`` or ``abort``, the last two only if the session is still
    the same, or ``restart``: power fails.
    """

    event: str
    after_ms: int
    action: str
    times: int = 1_000


@dataclass(frozen=True, slots=True)
class Application:
    """What the application of one station does.  It never thinks longer than half of t_decide."""

    whens: tuple[When, ...] = ()
    joins: bool = False
    """Every Advertisement concerns it."""
    target: int = 0
    """Whom it prescribes; 0: the lowest recorded."""
    refuses: int = 0
    """It refuses the first so many proposals of a session."""
    thinks_ms: int = 20
    """From a question (choose, verify, propose) to its answer."""
    lease_ms: int = LEASE_MS


@dataclass(frozen=True, slots=True)
class Play:
    """Stations on a radio; no lease is longer than LEASE_MS.

    ``story`` says of a station what its application must have been told in the end, in order: the
    name of each indication, of ``fallback`` with or without the reason.
    """

    stations: Mapping[int, Application]
    radio: tuple[Rule, ...] = ()
    story: Mapping[int, tuple[str, ...]] = field(default_factory=dict)
    seeds: int = 1
    """It is played so often, with a seed of its own each time."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a scenario came to."""

    verdict: Verdict
    reason: str = ""
    """Why it is neither PASS nor FAIL, in one line; of a PASS, what was left out."""
    finding: Finding = NOTHING_WRONG
    """About the station ``at.file``, or the property that is broken: S-4, S-5, S-8, L-1."""
    input: Input | None = None
    """The input that the rule decides."""
    came: list[str] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)
    """The last lines of the play that is not PASS."""
    log: list[str] = field(default_factory=list)
    """Logs of all stations, relative to the folder; if a play is not PASS, of that one."""


def hazard(
    tracks: Mapping[int, Track], excused: Mapping[int, set[tuple[int, int]]]
) -> Finding | None:
    """What is broken of S-4, S-5 or S-8 at this moment.

    ``excused``: for each station the sessions in which it aborted, lost CAMs or restarted.
    """
    acting = {station: t for station, t in tracks.items() if t.state.phase == "ACTUATING"}
    for me, t in acting.items():
        if t.state.role == "prescriber":
            target = acting.get(t.state.target)
            agreed = target is not None and (target.session, target.state.proposal) == (
                t.session,
                t.state.proposal,
            )
            if not agreed and t.session not in excused[t.state.target]:
                return _broken(
                    "S-5", f"{me} acts, and its target {t.state.target} is not committed to that"
                )
        for other, o in acting.items():
            words = (
                {o.state.target, other} if o.state.role == "prescriber" and other != me else set()
            )
            if t.state.role == "prescriber" and t.state.target in words:
                text = f"{me} and {other} act, both on what {t.state.target} has agreed to"
                return _broken("S-8", text)
            pair = {t.session[0], tracks[t.session[0]].state.target} if t.session else set()
            if o.session == t.session and other != me and pair != {me, other}:
                text = f"{me} and {other} act in one session, and are no pair in it"
                return _broken("S-4", text)
    return None


def _broken(name: str, text: str) -> Finding:
    return Finding("property", property=name, observed=text)


class Stage:
    """One play.  The same ``seed`` gives the same bytes.

    Time is a queue of deliveries and of what the applications do; at one time the stations' own
    deadlines come first.  Logs are written into ``folder``, which is there.
    """

    def __init__(
        self,
        play: Play,
        processes: Mapping[int, Connection],
        hello: HelloAnswer,
        folder: Path,
        seed: int,
    ) -> None:
        self._play, self._hello, self._seed = play, hello, seed
        self._processes = processes
        self._logs = {station: folder / f"{station}.ndjson" for station in play.stations}
        self._lines: list[Line] = []
        self._stations: dict[int, Monitor] = {}
        self._parameters = DEFAULTS | {str(name): ms for name, ms in hello.fixed.items()}
        self._radio = Radio(play.radio, self._parameters, seed)
        self._queue: list[tuple[int, int, bool, Callable[[], None]]] = []
        self._order = 0
        self._pending = 0
        """What is in the queue beside CAMs and the beat."""
        self._calm = 0
        self._now = START_MS
        self._done: dict[tuple[int, int], int] = {}
        self._indications: dict[int, list[str]] = {station: [] for station in play.stations}
        self._at = 0
        """The station that is spoken to."""

    def outcome(self, folder: Path) -> Outcome:
        """Play it, and judge.  Logs are named relative to ``folder``.

        Raises OSError.
        """
        end = "clean"
        try:
            self._run()
        except Diverges as d:
            return self._not_allowed(folder, d)
        except _Unsafe as error:
            return self._out(folder, Outcome("FAIL", finding=error.finding))
        except CannotTell as error:
            return self._elsewhere(folder, f"{self._at}: {error}")
        except (AdapterError, ProtocolError) as error:
            end = "crash"
            came = list(getattr(error, "stderr", ()))
            return self._out(folder, Outcome("ERROR", f"{self._at}: {error}", came=came))
        finally:
            for monitor in self._stations.values():
                monitor.end(end)
        for station, story in self._play.story.items():
            indication = self._indications[station]
            if len(indication) != len(story) or not all(map(_tells, story, indication)):
                text = (
                    f"every step is allowed, but {station} was told {', '.join(indication)}: this"
                )
                return self._elsewhere(folder, f"{text} scenario leads to {', '.join(story)}")
        return self._out(folder, Outcome("PASS"))

    def _elsewhere(self, folder: Path, text: str) -> Outcome:
        """Every step is allowed, so that only parameters can have led elsewhere."""
        fixed = [f"{n} {ms}" for n, ms in self._hello.fixed.items() if DEFAULTS[str(n)] != ms]
        if not fixed:
            return self._out(folder, Outcome("INCONC", text))
        text = f"{' and '.join(fixed)} would lead elsewhere: {text}"
        return self._out(folder, Outcome("SKIP", text))

    def _out(self, folder: Path, outcome: Outcome) -> Outcome:
        logs = [str(path.relative_to(folder)) for path in self._logs.values() if path.exists()]
        lines = [] if outcome.verdict == "PASS" else self._lines[-SHOWN:]
        return replace(outcome, lines=lines, log=logs)

    def _not_allowed(self, folder: Path, d: Diverges) -> Outcome:
        found = self._stations.get(self._at)
        last = None if found is None else found.last
        outcome = Outcome(
            "FAIL",
            finding=replace(d.finding, at=At(str(self._at), d.finding.at.line)),
            input=last.input if last is not None and d.finding.rule == last.rule else None,
            came=[said.text for said in self._lines[-1:] if said.who == "station"],
        )
        return self._out(folder, outcome)

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
            self._happened(station, "start")
        self._after(0, self._beat, counts=False)
        known = {**self._parameters, **derived(self._parameters)}
        lasts = sum(durations(known)[name] or 0 for name in ("hold", "quarantine", "cam"))
        end = START_MS + 3 * (LEASE_MS + lasts)
        while self._calm < CALM:
            due = [s.deadline for s in self._stations.values() if s.deadline is not None]
            self._now = max(self._now, min([self._queue[0][0], *due]))
            if self._now > end:
                self._check_ends()
            for station, monitor in self._stations.items():
                if monitor.deadline is not None and monitor.deadline <= self._now:
                    self._give(station, {"cmd": "advance"})
            while self._queue[0][0] <= self._now:
                _, _, counts, action = heapq.heappop(self._queue)
                self._pending -= counts
                action()
            self._check_hazards()

    def _after(self, ms: int, action: Callable[[], None], *, counts: bool = True) -> None:
        self._order += 1
        self._pending += counts
        heapq.heappush(self._queue, (self._now + ms, self._order, counts, action))

    def _beat(self) -> None:
        """CAMs come out in time: nobody sleeps longer than t_cam."""
        for station in self._stations:
            self._give(station, {"cmd": "advance"})
        resting = all(
            monitor.track.state.phase == "STANDALONE" and not monitor.track.outbox
            for monitor in self._stations.values()
        )
        self._calm = self._calm + 1 if resting and not self._pending else 0
        self._after(self._parameters["t_cam"], self._beat, counts=False)

    def _check_hazards(self) -> None:
        tracks = {station: monitor.track for station, monitor in self._stations.items()}
        excused = {station: monitor.excused for station, monitor in self._stations.items()}
        found = hazard(tracks, excused)
        if found is not None:
            raise _Unsafe(found)

    def _check_ends(self) -> None:
        """The play has lasted longer than its sessions may."""
        for station, monitor in self._stations.items():
            t = monitor.track
            if t.state.phase != "STANDALONE":
                text = f"{station} is still in {t.state.phase} at {self._now} ms"
                raise _Unsafe(_broken("L-1", text))
        raise CannotTell(f"messages are still being sent at {self._now} ms")

    # -- stations, radio and applications

    def _give(self, station: int, command: Object, tx: str | None = None) -> None:
        """Say it to a station; what it sends goes on the air, what it tells to its application."""
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
            self._happened(station, now)
        for indication in monitor.indications:
            name, more = (
                indication["name"],
                [indication["reason"]] if indication["name"] == "fallback" else [],
            )
            self._indications[station].append(" ".join([name, *more]))
            self._happened(station, name)
            self._asked(station, indication)

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

    def _asked(self, station: int, indication: Object) -> None:
        """The application of a station answers a question, after thinking."""
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
        self._after(thinks, partial(self._wants, station, command))

    def _happened(self, station: int, event: str) -> None:
        """What is due after an event in the life of a station."""
        session = self._stations[station].track.session
        for place, when in enumerate(self._play.stations[station].whens):
            done = self._done.get((station, place), 0)
            if when.event != event or done == when.times:
                continue
            self._done[station, place] = done + 1
            if when.action == "restart":
                action = partial(self._restart, station)
            else:
                action = partial(self._wants, station, self._command(when.action, session))
            self._after(when.after_ms, action)

    def _command(self, name: str, session: tuple[int, int] | None) -> Object:
        if name == "request":
            scenario = self._hello.scenarios[0]
            return {"name": name, "scenario": scenario, "details": {"lane": 2}}
        return {"name": name, "session": list(session or ())}

    def _wants(self, station: int, command: Object) -> None:
        """A command, unless it is about a session that the application was told the end of."""
        session = self._stations[station].track.session
        if command["name"] == "request" or list(session or ()) == command["session"]:
            self._give(station, {"cmd": "command", "command": command})

    def _restart(self, station: int) -> None:
        self._give(station, {"cmd": "restart"})
        self._happened(station, "restart")


class _Unsafe(Exception):
    """A property is broken."""

    def __init__(self, finding: Finding) -> None:
        super().__init__(finding.observed)
        self.finding = finding


def _trajectory(a: int, b: int) -> Object:
    """One that has these two numbers in it."""
    return {"t0": 0, "points": [[0, 0, 0], [1000, 8000 + b, a]]}


def _tells(wanted: str, indication: str) -> bool:
    return indication == wanted or indication.split()[0] == wanted
