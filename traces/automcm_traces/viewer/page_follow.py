"""A log followed for a page: the state of its station after each step, and its timers as bars."""

from __future__ import annotations

from dataclasses import dataclass, field

from automcm_spec.vocabulary.parameters import durations, lease_lasts
from automcm_spec.vocabulary.rules import handler, line
from automcm_traces.checker.follow import Ending, Watcher
from automcm_traces.checker.track import Step, Track
from automcm_traces.format.log import Restart, Timer, TimerArm, TimerEnd
from automcm_traces.format.reader import Log

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
    states: list[dict[str, object]] = field(default_factory=list)
    """After each step, what changed; every ``WHOLE`` steps, from the first on, everything."""
    bars: list[Bar] = field(default_factory=list)

    def state(self, step: int) -> dict[str, object]:
        """The whole state after a step."""
        first = step - step % WHOLE
        found: dict[str, object] = {}
        for change in self.states[first : step + 1]:
            found |= change
        return found


def values(t: Track) -> dict[str, object]:
    """The variables of a station, named as in Station.tla, as plain JSON."""
    st = t.state
    return {
        "phase": st.phase,
        "role": st.role,
        "session": f"{t.session[0]}/{t.session[1]}" if t.session else "none",
        "recorded": sorted(st.recorded),
        "withdrawn": sorted(st.withdrawn),
        "target": st.target,
        "proposal": st.proposal,
        "deciding": st.deciding,
        "watching": t.heard_ms is not None,
        "number": st.number,
        "joined": {str(p): n for p, n in sorted(st.joined)},
        "outbox": [
            f"{e.type} to {e.to}, {e.session[0]}/{e.session[1]} seq {e.message.seq}"
            for e in t.outbox
        ],
        "quarantine": st.quarantine,
        "backoff": st.backoff,
    }


class States(Watcher):
    """Keeps the states after the steps of a log; of a part of it, of those in these lines."""

    def __init__(self, shown: range) -> None:
        self.found, self._shown = Followed(), shown
        self._leases: dict[int, tuple[str, int]] = {}
        """By the line of an input, role and lease after it."""
        self._last: dict[str, object] = {}

    def step(self, step: Step, track: Track) -> None:
        """One more state."""
        if step.at not in self._shown:
            return
        now = values(track)
        whole = len(self.found.steps) % WHOLE == 0
        changed = {k: v for k, v in now.items() if whole or self._last.get(k) != v}
        self._decided(step, changed)
        self._leases[step.at] = track.state.role, track.lease_ms
        self._last = now

    def ended(self, ending: Ending) -> None:
        """Why there are no more states; they are known up to a divergence all the same."""
        found, d = self.found, ending.diverges
        if ending.lacking:
            kinds = ", ".join(sorted(ending.lacking))
            found.why_not = f"the log does not promise to hold every event of kind {kinds}"
        elif d is not None:
            found.why_not = f"the log leaves the specification at line {d.finding.at.line}"
            new = d.step is not None and (not found.steps or found.steps[-1] < d.step.at)
            if d.step is not None and new and d.step.at in self._shown:
                whole = len(found.steps) % WHOLE == 0
                self._decided(d.step, found.state(len(found.steps) - 1) if whole else {})
        elif ending.finding.kind == "cannot_tell":
            found.why_not = ending.finding.observed

    def _decided(self, step: Step, changed: dict[str, object]) -> None:
        """A step; if it does not go on as it must, its state is that before."""
        self.found.states.append(changed)
        self.found.steps.append(step.at)
        self.found.rules.append(step.rule)
        self.found.places.append((handler(step.input), line(step.rule, step.input)))

    def followed(self, log: Log) -> Followed:
        """What is shown of the log, or of a part of it."""
        _bars(log, self.found, self._leases)
        return self.found


def _bars(log: Log, found: Followed, leases: dict[int, tuple[str, int]]) -> None:
    """Every timer armed, with its end: expiry, stop, armed anew, a restart, or none."""
    open_: dict[Timer, Bar] = {}
    done: list[Bar] = found.bars
    lines = iter([*found.steps, None])
    step, due = None, next(lines)
    lasts = durations(log.header.known)

    def close(key: Timer, at: int, how: int) -> None:
        bar = open_.pop(key, None)
        if bar is not None:
            done.append(Bar(bar.armed, at, how, bar.logged_ms, bar.spec_ms))

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
