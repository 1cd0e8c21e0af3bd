"""Converts counterexamples in ITF to logs of their stations, and logs to ITF."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import from_json

from automcm_spec.log_format.log import RECORD
from automcm_spec.log_format.reader import Log
from automcm_spec.model_checking import models
from automcm_spec.model_checking.tla_values import Record
from automcm_spec.support.bad_input import at_line, errors_of
from automcm_spec.vocabulary.conditions import EMPTY
from automcm_spec.vocabulary.json_forms import input_of
from automcm_spec.vocabulary.parameters import derived
from automcm_spec.vocabulary.rules import handler, line
from automcm_spec.vocabulary.station import Message, State, Timer
from automcm_traces.checker.follow import Check, Watcher
from automcm_traces.checker.track import CannotTell, InputStep, Track
from automcm_traces.export import behaviour_to_log, itf
from automcm_traces.export.behaviour_effects import effects_of
from automcm_traces.export.behaviour_steps import Move, steps_of
from automcm_traces.system.fates import Arrow

TICK_MS = 100
"""The duration of a tick of a timed model."""
TICKS = (["tick"], ["slow tick"])


@dataclass(frozen=True)
class Behaviour:
    """A counterexample: its model and its steps."""

    model: str
    module: str
    cfg: str
    moves: list[Move]

    @property
    def timed(self) -> bool:
        """Whether the behaviour states the time of each step."""
        return any(move.at_ms is not None for move in self.moves)

    @property
    def reduced(self) -> bool:
        """Whether its model uses the reductions of System."""
        return not self.timed and "Reduced = TRUE" in self.cfg

    def constant(self, name: str) -> int:
        """An integer constant of the model."""
        found = re.search(rf"^  {name} = (\d+)$", self.cfg, re.M)
        if found is None:
            raise itf.ItfError(f"{self.model}: has no integer constant {name}")
        return int(found[1])

    def logs(self) -> dict[int, bytes]:
        """The log of each station, by its real id.

        Raises automcm_spec.model_checking.tlc.TlcError, behaviour_to_log.BehaviourError.
        """
        effects = partial(effects_of, self.module, self.cfg)
        (steps,) = steps_of([self.moves], effects, self.reduced)
        parameters = {"max_rounds": self.constant("MaxRounds")}
        lease = None
        if self.timed:
            resend, sendings = self.constant("ResendTime"), self.constant("Sendings")
            lease = self.constant("Lease") * TICK_MS
            ticks = {"t_resend": resend, "t_timeout": (sendings - 1) * resend}
            ticks |= {"t_decide": self.constant("Deciding"), "t_cam_loss": self.constant("CamLoss")}
            ticks |= derived(ticks)
            names = ["t_resend", "t_giveup", "t_decide", "t_cam_loss"]
            if "AdvertiseTime <-" not in self.cfg:
                names += ["t_advertise", "t_hold"]
            parameters |= {name: ticks[name] * TICK_MS for name in names}
        stations = sorted(self.moves[0].before)
        attacked = self.module in models.ATTACKED
        return behaviour_to_log.logs(
            self.model, steps, stations, parameters, lease, attacked=attacked
        )


def behaviour(path: Path) -> Behaviour:
    """The counterexample in a file written by ``automcm spec`` or ``make generate``.

    Raises OSError, and itf.ItfError with the file and the state.
    """
    try:
        value = from_json(path.read_bytes())
    except ValueError as error:
        raise itf.ItfError(f"{path}: not JSON: {error}") from None
    try:
        return _behaviour(value)
    except itf.ItfError as error:
        raise itf.ItfError(f"{path}: {error}") from None


def _behaviour(value: object) -> Behaviour:
    if not isinstance(value, dict):
        raise itf.ItfError("must be a JSON object")
    states = itf.from_itf(value)
    meta = value.get("#meta")
    source = meta.get("source") if isinstance(meta, dict) else None
    sources = {f"spec/models/models.toml#{m.cfg}": m for m in models.load()}
    model = sources.get(source) if isinstance(source, str) else None
    if model is None:
        raise itf.ItfError("#meta: source: must name a model, as in spec/models/models.toml#rejoin")
    if not states:
        raise itf.ItfError("'states' is empty")
    if model.module in models.ALONE:
        raise itf.ItfError(
            f"{model.cfg} has no logs: in {model.module} a station receives messages that "
            "nobody has sent"
        )
    moves, ticks = [], 0
    for one, two in pairwise(model_states(states)):
        ticks += two.input in TICKS
        moves.append(_move(one, two, ticks))
    return Behaviour(model.cfg, model.module, model.config, moves)


class ModelState(BaseModel):
    """A state of a closed model, and the step that led to it."""

    model_config = ConfigDict(strict=True)

    st: tuple[State, ...]
    net: frozenset[Message]
    clock: tuple[dict[Timer, int] | tuple[()], ...] | None = None
    """For each station of a timed model, by timer, the ticks until it is due."""
    next: tuple[int, ...] | None = None
    """For each station, the ticks until it sends a CAM."""
    lost: tuple[int, ...] | None = None
    """For each station, the ticks that its clock has lost (Drift.tla)."""
    input: Annotated[list[Any], Field(min_length=1)]
    """The input, in its JSON form."""
    station: int = 0
    """0 is the radio or time."""


def model_states(states: Sequence[itf.ItfState]) -> list[ModelState]:
    """Raises itf.ItfError, naming state and field, unless the states are stations with an input
    each."""
    found: list[ModelState] = []
    for index, state in enumerate(states):
        given = {"input": ["none"]} if index == 0 else {}
        try:
            one = ModelState.model_validate({**state.values, **given, **state.meta})
        except ValidationError as error:
            raise _refused(index, ": ".join(errors_of(error)[0])) from None
        found.append(one)
        stations, timed = len(found[0].st), found[0].clock is not None
        for name in ("st", "clock", "next", "lost"):
            value = getattr(one, name)
            if value is None and timed and name != "lost":
                raise _refused(index, f"{name}: missing")
            if value is not None and len(value) != stations:
                raise _refused(index, f"{name}: must have {stations} entries, one per station")
        if not 0 <= one.station <= stations:
            raise _refused(index, f"station: must be from 0 to {stations}")
    return found


def _refused(index: int, problem: str) -> itf.ItfError:
    return itf.ItfError(f"state {index}: not a step of a station: {problem}")


def _move(one: ModelState, two: ModelState, ticks: int) -> Move:
    before, after = (dict(enumerate(at.st, 1)) for at in (one, two))
    station = two.station
    given = input_of(two.input) if station else None
    if two.clock is None or one.clock is None:
        net, net_after = (frozenset(map(behaviour_to_log.plain, at.net)) for at in (one, two))
        return Move(station, given, before, after, net, net_after)
    at_ms = ticks * TICK_MS
    lost, lost_before = (dict(enumerate(at.lost or (), 1)) for at in (two, one))
    behind = {n: ticks * TICK_MS for n, ticks in lost.items()}
    if not station:
        slow = {n for n, ticks in lost.items() if ticks != lost_before[n]}
        due = [s for s, left in enumerate(one.next or (), 1) if left == 1 and s not in slow]
        cams = tuple(due) if two.input in TICKS else ()
        return Move(0, None, before, after, at_ms=at_ms, cams=cams, behind_ms=behind)
    left, was = dict(two.clock[station - 1]), dict(one.clock[station - 1])
    now = at_ms - behind.get(station, 0)
    deadlines = {timer: now + ticks * TICK_MS for timer, ticks in left.items()}
    anew = frozenset(t for t in left if t in was and left[t] > was[t])
    more = at_ms, behind, deadlines, (), anew
    return Move(station, given, before, after, EMPTY, EMPTY, *more)


def from_log(log: Log, arrows: Sequence[tuple[int, Arrow]] = ()) -> str:
    """A log as ITF: the station's state in the specification after each step, with real ids.

    The ``#meta`` of a state contains ``action`` (the operator of Station.tla), ``args`` (the
    content of the event), ``rule``, ``t_ms``, the ``line`` of the log, the ``location`` in
    Station.tla, and ``messages``: the messages that arrive in the step, or leave in it and arrive
    nowhere, with their lines and fates. ``arrows`` are those of the log, by line. The states of a
    diverging log end with the last allowed step, and the description says so. Raises
    automcm_traces.checker.track.CannotTell.
    """
    watcher = _Steps(log)
    check = Check(log, watchers=[watcher], one=True).read()
    if not check.decided:
        found = check.finding
        raise CannotTell(f"{at_line(log.file, found.at.line)}: {found.observed}")
    divergence = ""
    if check.diverges is not None:
        found = check.diverges.finding
        divergence = f" It diverges at line {found.at.line}: {found.observed}."
    watcher.add_messages(arrows)
    about = {
        "description": f"Station {log.header.station} of run {log.header.run}.{divergence}",
        "source": Path(log.file).name,
    }
    return itf.dumps(itf.to_itf(watcher.states, about))


class _Steps(Watcher):
    """Keeps the state after each step."""

    def __init__(self, log: Log) -> None:
        self.states = [itf.ItfState(_values(Track(log.header.station)))]

    def step(self, step: InputStep, track: Track) -> None:
        event = RECORD.dump_python(step.event, mode="json", exclude_none=True) if step.event else {}
        shown = ("message", "planned", "command", "timer", "raw")
        meta: dict[str, object] = {
            "action": handler(step.input),
            "args": {name: event[name] for name in shown if name in event},
            "rule": step.rule,
            "t_ms": step.t_ms,
            "line": step.at,
            "location": {"module": "Station", "line": line(step.rule, step.input)},
        }
        self.states.append(itf.ItfState(_values(track), meta))

    def add_messages(self, arrows: Sequence[tuple[int, Arrow]]) -> None:
        """Add each arrow to the last step at or before its line."""
        lines: list[Any] = [state.meta["line"] for state in self.states[1:]]
        for line_, arrow in arrows:
            k = bisect_right(lines, line_)
            meta = dict(self.states[k].meta)
            known: Any = meta.get("messages", [])
            meta["messages"] = [*known, {**arrow.as_dict(), "line": line_}]
            self.states[k] = itf.ItfState(self.states[k].values, meta)


def _values(t: Track) -> dict[str, object]:
    """The variables of a station, named as in Station.tla."""
    outbox = frozenset(Record(e._asdict()) for e in t.state.outbox)
    return {**t.state._asdict(), "outbox": outbox}
