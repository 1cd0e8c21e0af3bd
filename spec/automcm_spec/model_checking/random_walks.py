"""Random behaviours of a model: whether a property is violated, and how often each rule decided."""

from __future__ import annotations

import builtins
import re
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

from automcm_spec.model_checking import models, tlc
from automcm_spec.support import scratch
from automcm_spec.support.paths import SIMULATION, TLA
from automcm_spec.vocabulary.rules import RULES

EndReason = Literal["time", "number", "violation"]

MODULE = """---- MODULE Walk ----
EXTENDS {module}, Simulation, TLC
VARIABLE walked
WalkInit == Init /\\ walked = 0
Told == PrintT(<<"walk", walked, last.rule>>)
WalkNext ==
  \\E s \\in Stations : /\\ Told /\\ walked < {depth} /\\ walked' = walked + 1
                      /\\ \\E i \\in Inputs(s) : {guard}Do(s, i)
WalkSpec == WalkInit /\\ [][WalkNext]_<<vars, walked>>
====
"""
"""The AnyNext of Simulation.tla, which first prints how the current state was reached.

TLC chooses the station first. It computes successors only for the current state of a walk, at most
once per station. (An invariant would also see successors that are not chosen.)
"""

_REACHED_BY = re.compile(r'<<"walk", (\d+), "([^"]+)">>$')


@dataclass(frozen=True)
class WalkModel:
    """A model for random walks: the text of its cfg, its module, and the property it must violate,
    if any."""

    name: str
    cfg: str
    module: str
    breaks: str | None = None


@dataclass(frozen=True)
class Walks:
    """The result of the walks.

    ``ended`` is the reason for the end. A behaviour that the time limit interrupted is not counted.
    ``rules`` is the number of steps that each rule decided, without zeros. Inputs that change
    nothing and CAMs are not steps of System, so rules that only ignore an input do not appear.
    ``property`` is the id of the violated property, and ``trace`` the behaviour that violates it.
    """

    model: WalkModel
    seed: int
    depth: int
    behaviours: int
    steps: int
    rules: dict[str, int]
    ended: EndReason
    property: str | None = None
    trace: tuple[tlc.TraceState, ...] = ()

    @builtins.property
    def never(self) -> list[str]:
        """The rules that decided no step."""
        return [rule for rule in RULES if rule not in self.rules]

    @builtins.property
    def exit_code(self) -> int:
        """0 as expected; 1 if a property is violated unexpectedly; 4 if the result is
        inconclusive."""
        if self.property is not None:
            return 0 if self.property == self.model.breaks else 1
        return 4 if self.model.breaks or not self.behaviours else 0

    def as_dict(self) -> dict[str, Any]:
        """The report as JSON; equal for equal behaviours."""
        return {
            "model": self.model.name,
            "seed": self.seed,
            "depth": self.depth,
            "behaviours": self.behaviours,
            "steps": self.steps,
            "ended": self.ended,
            "property": self.property,
            "length": len(self.trace) or None,
            "rules": {rule: self.rules.get(rule, 0) for rule in RULES},
            "never": self.never,
        }


def known() -> dict[str, WalkModel]:
    """The models for random walks by name: the listed models and those of spec/simulation.

    Raises models.ModelError.
    """
    listed = [WalkModel(m.cfg, m.config, m.module, m.property) for m in models.load()]
    larger = [
        WalkModel(path.stem, path.read_text(encoding="utf-8"), "System")
        for path in sorted(SIMULATION.glob("*.cfg"))
    ]
    return {model.name: model for model in [*listed, *larger]}


def run(
    model: WalkModel,
    *,
    seed: int = 1,
    depth: int = 100,
    seconds: float | None = 30,
    number: int | None = None,
    lively: bool = False,
    on_progress: Callable[[int], None] | None = None,
) -> Walks:
    """Random behaviours of a model, of at most ``depth`` steps, until one violates a property.

    They end after ``seconds`` (including the start of Java) or ``number`` behaviours, whichever
    comes first. Equal seeds give equal behaviours; the time limit only affects their number.
    ``lively`` excludes inputs that end sessions early (Simulation.tla). on_progress receives the
    number of behaviours so far. Raises models.ModelError for a model that does not extend System,
    tlc.TlcError if TLC fails.
    """
    texts = {path.stem: path.read_text(encoding="utf-8") for path in TLA.glob("*.tla")}
    if "System" not in models.extended(model.module, texts):
        raise models.ModelError(f"{model.name}: the module {model.module} must extend System")
    count = _Count(on_progress)
    result = None
    with scratch.folder("walks") as place:
        for path in TLA.glob("*.tla"):
            shutil.copy(path, place)
        guard = r"~Early(s, i) /\ " if lively else ""
        text = MODULE.format(module=model.module, depth=depth, guard=guard)
        (place / "Walk.tla").write_text(text, encoding="utf-8")
        (place / "Walk.cfg").write_text(_config(model), encoding="utf-8")
        extra = ["-simulate", *([] if number is None else [f"num={number}"])]
        extra += ["-depth", str(depth + 2), "-seed", str(seed)]
        try:
            result = tlc.run(
                "Walk",
                place / "Walk.cfg",
                tla_dir=place,
                extra=extra,
                timeout_s=seconds,
                on_print=count.line,
            )
        except tlc.TlcError as error:
            if error.kind != "timeout":
                raise
    if result is None:
        return Walks(model, seed, depth, *count.counts(), "time")
    if result.outcome == "holds":
        count.end()
        return Walks(model, seed, depth, *count.counts(), "number")
    name = result.property or model.breaks or "a property"
    trace = tuple(_named(state) for state in result.trace)
    count.end([_last(state)["rule"] for state in trace[1:]])
    found = models.PROPERTY_IDS.get(name, name)
    return Walks(model, seed, depth, *count.counts(), "violation", found, trace)


class _Count:
    """Counts behaviours, steps and rules from the lines of a walk: (step, rule that decided it)."""

    def __init__(self, on_progress: Callable[[int], None] | None) -> None:
        self._on_progress = on_progress
        self._behaviours = 0
        self._rules: Counter[str] = Counter()
        self._current: list[str] = []

    def line(self, text: str) -> None:
        if not (match := _REACHED_BY.match(text)):
            return
        step, rule = int(match[1]), match[2]
        if step == 0 and self._current:
            self.end()
        elif step > len(self._current):
            self._current.append(rule)

    def end(self, rules: list[str] | None = None) -> None:
        """End the behaviour; rules decided its steps, if they are known more precisely."""
        self._rules.update(self._current if rules is None else rules)
        self._behaviours += 1
        self._current = []
        if self._on_progress:
            self._on_progress(self._behaviours)

    def counts(self) -> tuple[int, int, dict[str, int]]:
        return self._behaviours, self._rules.total(), dict(self._rules)


def _last(state: tlc.TraceState) -> Any:
    return state.values["last"]


def _named(state: tlc.TraceState) -> tlc.TraceState:
    """The state with the action of System that led to it, named after the kind of input.

    TLC only knows the action WalkNext.
    """
    return replace(state, action=str(_last(state)["input"]["kind"]).capitalize())


def _config(model: WalkModel) -> str:
    text, found = re.subn(r"^SPECIFICATION Spec$", "SPECIFICATION WalkSpec", model.cfg, flags=re.M)
    if found != 1:
        text = "its cfg must contain SPECIFICATION Spec, as System's does"
        raise models.ModelError(f"{model.name}: {text}")
    return text
