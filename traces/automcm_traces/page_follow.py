"""A log followed for a page: the state of its station after each step, and its timers as bars."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from automcm_spec.parameters import durations, lease_lasts
from automcm_spec.rules import handler, line
from automcm_traces.engine import Engine
from automcm_traces.explain import NEEDED
from automcm_traces.log import Event, Restart, TimerArm, TimerEnd
from automcm_traces.reader import Log
from automcm_traces.step import Diverges, Step
from automcm_traces.timers import timer_key
from automcm_traces.track import CannotTell, Track

Json = Any
WHOLE = 100
"""Steps from one whole state to the next; between them only what changes is written."""
STOPPED, EXPIRED, REARMED, OPEN, RESTARTED = range(5)
"""How a bar ends."""


@dataclass(frozen=True, slots=True)
class Bar:
    """A timer from where it was armed to where it ended."""

    armed: int
    """Place of the event in ``Log.events``."""
    ended: int
    """Likewise; -1 if it never did."""
    how: int
    logged_ms: int
    """How long it was to run, as the log says."""
    spec_ms: int
    """As the specification says with the parameters of the header; -1 if they do not tell."""


@dataclass(slots=True)
class Followed:
    """What is shown of a station beside its events."""

    why_not: str = ""
    """Why its states are not known; they are known up to a divergence all the same."""
    steps: list[int] = field(default_factory=list)
    """Lines of the inputs."""
    rules: list[str] = field(default_factory=list)
    places: list[tuple[str, int]] = field(default_factory=list)
    """The operator of Station.tla and the line in it that decided each."""
    states: list[Json] = field(default_factory=list)
    """After each step, what changed; every ``WHOLE`` steps, from the first on, everything."""
    bars: list[Bar] = field(default_factory=list)

    def state(self, step: int) -> dict[str, Json]:
        """The whole state after a step."""
        first = step - step % WHOLE
        found: dict[str, Json] = {}
        for change in self.states[first : step + 1]:
            found |= change
        return found


def follow(log: Log, whole: Iterable[tuple[int, Event]] | None = None) -> Followed:
    """Follow a log as far as the specification allows it.  If it is a part, ``whole`` are the
    events of the whole log: those before are followed, and not kept."""
    found = Followed()
    leases = _states(log, log.events if whole is None else whole, found)
    _bars(log, found, leases)
    return found


def values(t: Track) -> dict[str, Json]:
    """The variables of a station, named as in Station.tla, as plain JSON."""
    return {
        "phase": t.phase,
        "role": t.role,
        "session": f"{t.session[0]}/{t.session[1]}" if t.session else "none",
        "recorded": sorted(t.recorded),
        "withdrawn": sorted(t.withdrawn),
        "target": t.target,
        "proposal": t.proposal,
        "deciding": t.deciding,
        "watching": t.heard_ms is not None,
        "number": t.number,
        "joined": {str(p): n for p, n in sorted(t.joined.items())},
        "outbox": [
            f"{e.type} to {e.to}, {e.session[0]}/{e.session[1]} seq {e.message['seq']}"
            for e in t.outbox
        ],
        "quarantine": t.quarantine,
        "backoff": t.backoff,
    }


def _states(log: Log, events: Iterable[tuple[int, Event]], found: Followed) -> dict[int, int]:
    """Follow; returns, by the line of an input, the lease in force after it."""
    lacking = set(NEEDED) - set(log.header.complete)
    leases: dict[int, int] = {}
    if lacking:
        kinds = ", ".join(sorted(lacking))
        found.why_not = f"the log does not promise to hold every event of kind {kinds}"
        return leases
    last: dict[str, Json] = {}
    shown = range(log.events[0][0], log.events[-1][0] + 1) if log.events else range(0)
    latest = 0

    def after(step: Step, track: Track) -> None:
        nonlocal last, latest
        latest = step.at
        if step.at not in shown:
            return
        now = values(track)
        whole = len(found.steps) % WHOLE == 0
        changed = {k: v for k, v in now.items() if whole or last.get(k) != v}
        found.steps.append(step.at)
        found.rules.append(step.rule)
        found.places.append((handler(step.input), line(step.rule, step.input)))
        found.states.append(changed)
        drift = log.header.known.get("clock_drift", 0)
        leases[step.at] = lease_lasts(drift, track.role, track.lease_ms) if track.lease_ms else 0
        last = now

    try:
        engine = Engine(log)
        engine.observer = after
        for at, event in events:
            engine.feed(at, event)
            if latest >= shown.stop:
                break  # only the input after it says that the last step is over
        if log.ended:
            engine.finish()
    except Diverges as d:
        found.why_not = f"the log leaves the specification at line {d.at}"
        new = d.step is not None and (not found.steps or found.steps[-1] < d.step.at)
        if d.step is not None and new and d.step.at in shown:
            _decided(found, d.step)
    except CannotTell as error:
        found.why_not = str(error)
    except (KeyError, TypeError, IndexError, ValueError, AttributeError) as error:
        found.why_not = f"a message lacks or misuses a field: {error}"
    return leases


def _decided(found: Followed, step: Step) -> None:
    """The step that did not go on as it must: its rule is known, its state is that before."""
    found.states.append(found.state(len(found.steps) - 1) if len(found.steps) % WHOLE == 0 else {})
    found.steps.append(step.at)
    found.rules.append(step.rule)
    found.places.append((handler(step.input), line(step.rule, step.input)))


def _bars(log: Log, found: Followed, leases: dict[int, int]) -> None:
    """Every timer armed, with its end: expiry, stop, armed anew, a restart, or none."""
    open_: dict[str, Bar] = {}
    done: list[Bar] = found.bars
    lines = iter([*found.steps, None])
    step, due = None, next(lines)
    lasts = durations(log.header.known)

    def close(key: str, at: int, how: int) -> None:
        bar = open_.pop(key, None)
        if bar is not None:
            done.append(Bar(bar.armed, at, how, bar.logged_ms, bar.spec_ms))

    for n, (at, event) in enumerate(log.events):
        while due is not None and due <= at:
            step, due = due, next(lines)
        match event:
            case TimerArm(timer=timer):
                key = timer_key(timer.model_dump(exclude_none=True))
                close(key, n, REARMED)
                wanted = lasts[timer.name]
                if timer.name == "lease":
                    wanted = leases.get(step or 0) or None
                spec_ms = -1 if wanted is None else wanted
                open_[key] = Bar(n, -1, OPEN, event.deadline - event.t_ms, spec_ms)
            case TimerEnd(timer=timer, op=op):
                key = timer_key(timer.model_dump(exclude_none=True))
                close(key, n, EXPIRED if op == "expire" else STOPPED)
            case Restart():
                for key in [k for k in open_ if k != "quarantine"]:
                    close(key, n, RESTARTED)
    done += open_.values()
    done.sort(key=lambda bar: (bar.armed, bar.ended))
