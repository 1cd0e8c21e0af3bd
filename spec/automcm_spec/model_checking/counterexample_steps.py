"""The steps of a counterexample: action, station, input, rule, and changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeAlias

from automcm_spec.model_checking.tlc import TraceState
from automcm_spec.vocabulary import json_forms
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.rules import handler, line
from automcm_spec.vocabulary.station import Input, Message, State

#: The events of a model that are not steps of a station.
EVENTS = {
    "tick": "a tick passes",
    "slow tick": "a tick passes, and a slow clock does not count it",
    "cut": "the radio is cut",
    "silence": "no CAM is received from here on",
    "lose": "a message is lost",
}


Event: TypeAlias = tuple[str] | tuple[str, Message]


@dataclass(frozen=True)
class ModelStep:
    """One step.

    index counts from 1. action is the name of the action in the next-state relation, as TLC prints
    it. station is its id, or None for an event of the radio or of time. input has the model's ids.
    line is the line of Station.tla where the rule decided, 0 for an event. changes maps each
    changed field of the station to its values before and after.
    """

    index: int
    action: str
    station: int | str | None
    input: Input | Event
    rule: str | None
    line: int
    changes: dict[str, tuple[Any, Any]]

    @property
    def text(self) -> str:
        """The step on one line, and its changes on another."""
        if not isinstance(self.input, Input):
            event, *about = self.input
            return ": ".join([self.action, EVENTS[event], *map(canonical, about)])
        by = f"[{self.rule}: {handler(self.input)}, Station.tla:{self.line}]"
        fields = [f"{n} {canonical(a)} → {canonical(b)}" for n, (a, b) in self.changes.items()]
        changed = ", ".join(fields) or "nothing changes"
        who = f"{self.action} at station {self.station}"
        return f"{who}: {canonical(self.input)}  {by}\n     {changed}"


def steps(trace: Sequence[TraceState]) -> list[ModelStep]:
    """The steps of a trace of any model. TLC does not print the arguments of actions; the variable
    ``last`` contains them."""
    return [_step(before, after) for before, after in pairwise(trace)]


def _step(before: TraceState, after: TraceState) -> ModelStep:
    last: Any = after.values["last"]
    given, who, rule = last["input"], last["station"], last["rule"]
    number, action = after.index - 1, after.action
    if given["kind"] in EVENTS:
        about = (Message(**given["message"]),) if "message" in given else ()
        return ModelStep(number, action, None, (given["kind"], *about), None, 0, {})
    value = json_forms.input_of(given)
    old = json_forms.state(_of(before.values["st"], who))
    new = json_forms.state(_of(after.values["st"], who))
    changes = {n: (a, b) for n, a, b in zip(State._fields, old, new, strict=True) if a != b}
    return ModelStep(number, action, who, value, rule, line(rule, value), changes)


def _of(stations: Any, who: Any) -> Any:
    """The state of station ``who`` in the variable st: a sequence, a function of ids, or the only
    one."""
    if isinstance(stations, Mapping) and "phase" in stations:
        return stations
    return stations[who] if isinstance(stations, Mapping) else stations[who - 1]
