"""The state of a station after each step of its log, and its timers as bars, for a page."""

from __future__ import annotations

from dataclasses import dataclass, field

from automcm_spec.log_format.log import Restart, Timer, TimerArm, TimerEnd
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary.parameters import durations, lease_lasts
from automcm_spec.vocabulary.rules import handler, line
from automcm_traces.checker.follow import Check, Watcher
from automcm_traces.checker.track import InputStep, Track

KEYFRAME = 100
"""The distance in steps between complete states; between them, only changes are stored."""
STOPPED, EXPIRED, REARMED, OPEN, RESTARTED = range(5)
"""How a bar ends."""


@dataclass(slots=True)
class Bar:
    """A timer from its arming to its end."""

    armed: int
    """The index of the event in ``Log.events``."""
    ended: int
    """The index of the event in ``Log.events``; -1 if it never ended."""
    how: int
    logged_ms: int
    """The duration according to the log."""
    spec_ms: int
    """The duration according to the specification, with the parameters of the header; -1 if they
    are not sufficient."""


@dataclass(slots=True)
class StateHistory:
    """The states and timers of a station, shown beside its events."""

    why_not: str = ""
    """Why its states are unknown; even then they are known up to a divergence."""
    steps: list[int] = field(default_factory=list)
    """The lines of the inputs."""
    decided: list[tuple[str, str, int]] = field(default_factory=list)
    """For each step, the rule and the operator of Station.tla that decided it, and the line."""
    states: list[dict[str, object]] = field(default_factory=list)
    """The change after each step; every ``KEYFRAME`` steps, from the first on, the complete
    state."""
    bars: list[Bar] = field(default_factory=list)
    due: list[tuple[str, int]] = field(default_factory=list)
    """Type and addressee of the messages that are missing where the log diverges."""

    def state(self, step: int) -> dict[str, object]:
        """The complete state after a step."""
        first = step - step % KEYFRAME
        found: dict[str, object] = {}
        for change in self.states[first : step + 1]:
            found |= change
        return found


def values(t: Track) -> dict[str, object]:
    """The variables of a station, with the names of Station.tla, as plain JSON."""
    st = t.state
    return st._asdict() | {
        "session": f"{t.session[0]}/{t.session[1]}" if t.session else "none",
        "recorded": sorted(st.recorded),
        "withdrawn": sorted(st.withdrawn),
        "joined": {str(p): n for p, n in sorted(st.joined)},
        "outbox": [
            f"{e.type} to {e.to}, {e.session[0]}/{e.session[1]} seq {message.seq}"
            for e, message in t.outbox
        ],
    }


class States(Watcher):
    """Records the states after the steps whose lines are in ``shown``."""

    def __init__(self, shown: range) -> None:
        self.found, self._shown = StateHistory(), shown
        self._leases: dict[int, tuple[str, int]] = {}
        """For the line of each input, the role and the lease after it."""
        self._last: dict[str, object] = {}

    def step(self, step: InputStep, track: Track) -> None:
        """Record a state."""
        if step.at not in self._shown:
            return
        now = values(track)
        is_keyframe = len(self.found.steps) % KEYFRAME == 0
        changed = {k: v for k, v in now.items() if is_keyframe or self._last.get(k) != v}
        self._decided(step, changed)
        self._leases[step.at] = track.state.role, track.lease_ms
        self._last = now

    def ended(self, check: Check) -> None:
        """Record why there are no more states, if so."""
        found, d = self.found, check.diverges
        if check.unpromised:
            kinds = ", ".join(sorted(check.unpromised))
            found.why_not = f"`complete` in the header of the log lacks {kinds}"
        elif d is not None:
            found.why_not = f"the log diverges from the specification at line {d.finding.at.line}"
            if d.step is not None and d.seen is None:
                found.due = [(each.value.type, each.value.dst) for each in d.step.messages]
            new = d.step is not None and (not found.steps or found.steps[-1] < d.step.at)
            if d.step is not None and new and d.step.at in self._shown:
                is_keyframe = len(found.steps) % KEYFRAME == 0
                self._decided(d.step, found.state(len(found.steps) - 1) if is_keyframe else {})
        elif check.finding.kind == "cannot_tell":
            found.why_not = check.finding.observed

    def _decided(self, step: InputStep, changed: dict[str, object]) -> None:
        """Record a step; the step of a divergence keeps the state before it."""
        self.found.states.append(changed)
        self.found.steps.append(step.at)
        place = handler(step.input), line(step.rule, step.input)
        self.found.decided.append((step.rule, *place))

    def history(self, log: Log) -> StateHistory:
        """The history of the log, or of a part of it."""
        _bars(log, self.found, self._leases)
        return self.found


def _bars(log: Log, found: StateHistory, leases: dict[int, tuple[str, int]]) -> None:
    """Add a bar for every armed timer, with its end: expiry, stop, re-arming, restart, or none."""
    open_: dict[Timer, Bar] = {}
    done: list[Bar] = found.bars
    lines = iter([*found.steps, None])
    step, due = None, next(lines)
    lasts = durations(log.header.known)

    def close(key: Timer, at: int, how: int) -> None:
        bar = open_.pop(key, None)
        if bar is not None:
            bar.ended, bar.how = at, how
            done.append(bar)

    for n, (at, event) in enumerate(log.events):
        while due is not None and due <= at:
            step, due = due, next(lines)
        match event:
            case TimerArm(timer=timer):
                close(timer, n, REARMED)
                wanted = lasts[timer.name]
                if timer.name == "lease":
                    role, lease_ms = leases.get(step or 0, ("", 0))
                    drift = log.header.known.get("clock_drift", 0)
                    wanted = lease_lasts(drift, role, lease_ms) if lease_ms else None
                spec_ms = -1 if wanted is None else wanted
                open_[timer] = Bar(n, -1, OPEN, event.deadline - event.t_ms, spec_ms)
            case TimerEnd(timer=timer, op=op):
                close(timer, n, EXPIRED if op == "expire" else STOPPED)
            case Restart():
                for key in [k for k in open_ if k.name != "quarantine"]:
                    close(key, n, RESTARTED)
    done += open_.values()
    done.sort(key=lambda bar: (bar.armed, bar.ended))
