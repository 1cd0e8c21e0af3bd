"""``automcm spec``: single models, and their counterexamples as inputs and changed fields."""

from __future__ import annotations

import shlex
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from automcm_cli.shared.common import unknown
from automcm_spec.graph import oracle_generation
from automcm_spec.model_checking import counterexample_steps as steps_
from automcm_spec.model_checking import models, tlc
from automcm_spec.model_checking.random_walks import Walks
from automcm_spec.support import files
from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary.json_forms import to_json
from automcm_traces.export import itf


def described(model: models.Model) -> str:
    """One line for ``automcm spec list``."""
    must = f"must break {model.property}" if model.expect == "violates" else "must hold"
    return f"{model.cfg:28}{must:20}{model.profile:7}{model.why}"


def checks(model: models.Model) -> str:
    """The properties that a model checks; ``S-1..5`` are S-1 to S-5."""
    checked = _ids(model)
    runs: list[list[str]] = []
    for id_ in models.PROPERTIES:
        letter, _, number = id_.partition("-")
        if id_ not in checked or not number:
            continue
        if runs and runs[-1][-1] == f"{letter}-{int(number) - 1}":
            runs[-1].append(id_)
        else:
            runs.append([id_])
    return " ".join(_run(run) for run in runs) or "-"


def _run(ids: list[str]) -> str:
    return " ".join(ids) if len(ids) < 3 else f"{ids[0]}..{ids[-1].partition('-')[2]}"


def _ids(model: models.Model) -> set[str | None]:
    """The ids of the properties that a model checks."""
    checked = models.checked_in(model.config)
    return {models.PROPERTY_IDS.get(name) for name in checked}


def chosen(
    loaded: Sequence[models.Model], names: Sequence[str], profile: str | None, property_: str | None
) -> list[models.Model]:
    """The models with these names, or of the profile, that check the property if one is given.

    Raises ValueError for an unknown name, with the nearest matches, and if no model is left.
    """
    known = {model.cfg: model for model in loaded}
    for name in names:
        if name not in known:
            raise ValueError(unknown(name, list(known)))
    if profile is not None and profile not in models.PROFILES:
        raise ValueError(unknown(profile, models.PROFILES, "profile"))
    ids = {id_: id_ for id_ in models.PROPERTIES} | models.PROPERTY_IDS
    if property_ is not None and property_ not in ids:
        raise ValueError(unknown(property_, list(ids), "property"))
    found = [known[name] for name in names]
    if not names:
        found = models.of_profile(loaded, profile) if profile else list(loaded)
    if property_ is not None:
        found = [m for m in found if ids[property_] in _ids(m)]
    if not found:
        raise ValueError("no model matches all options; automcm spec list shows the models")
    return found


def check(
    model: models.Model, notify: Callable[[str], None], timeout_s: float | None, heap_mb: int | None
) -> models.ModelVerdict:
    """Run TLC on one model and report its progress."""

    def progress(p: tlc.Progress) -> None:
        notify(f"{model.cfg}: depth {p.depth}, {p.distinct_states:,} states, {p.queue:,} to go")

    notify(model.cfg)
    return models.check(model, on_progress=progress, timeout_s=timeout_s, heap_mb=heap_mb)


def counterexample(verdict: models.ModelVerdict) -> str:
    """A counterexample as ITF, each step with its action, input, rule and line."""
    values = [
        {name: value for name, value in state.values.items() if name != "last"}
        for state in verdict.trace
    ]
    states = [itf.ItfState(values[0], {"index": 0})]
    for step, value in zip(steps_.steps(verdict.trace), values[1:], strict=True):
        meta: dict[str, Any] = {
            "index": step.index,
            "action": step.action,
            "input": to_json(step.input),
        }
        if step.station is not None:
            meta |= {"rule": step.rule, "station": step.station}
            meta["location"] = {"module": "Station", "line": step.line}
        states.append(itf.ItfState(value, meta))
    description = f"{verdict.model.cfg} breaks {verdict.property}. {verdict.model.why}"
    about = {"description": description, "source": f"spec/models/{models.LIST}#{verdict.model.cfg}"}
    loop = verdict.result.loop if verdict.result else None
    return itf.dumps(itf.to_itf(states, about, loop=None if loop is None else loop - 1))


def write_trace(verdict: models.ModelVerdict, folder: Path) -> Path:
    """Write the counterexample as ITF into a folder and return its path."""
    files.folder(folder, named=True)
    path = folder / f"{verdict.model.cfg}.itf.json"
    files.write(path, counterexample(verdict))
    return path


def kept(model: models.Model, folder: Path = Path("runs/models")) -> str:
    """Write the cfg of a model into a folder; returns the shell command that runs TLC with it.

    Raises OSError and tlc.TlcError.
    """
    files.folder(folder, named=True)
    cfg = models.written(model, folder).resolve()
    java, jar = tlc.tools()
    options = f"-metadir {shlex.quote(tempfile.gettempdir())} -config {shlex.quote(str(cfg))}"
    command = f"{shlex.quote(str(java))} -cp {shlex.quote(str(jar))} tlc2.TLC {options}"
    return f"cd {shlex.quote(str(TLA))} && {command} {model.module}"


def as_dict(verdict: models.ModelVerdict) -> dict[str, Any]:
    """A model and its outcome, as in the JSON of ``automcm verify``."""
    result = verdict.result
    return {
        "name": verdict.model.cfg,
        "expect": verdict.model.expect,
        "outcome": verdict.outcome,
        "property": verdict.property,
        "distinct_states": result.distinct_states if result else None,
        "states": result.states if result else None,
        "depth": result.depth if result else None,
        "length": len(verdict.trace) or None,
        "seconds": round(result.seconds, 1) if result else None,
        "reached": list(verdict.reached) or None,
        "states_looked_at": verdict.partial.distinct_states if verdict.partial else None,
        "problem": verdict.problem,
    }


def specification_changed() -> bool:
    """Whether Station.tla or OpenStation.tla has changed since the committed graphs were made.

    The recorded results of the models are as old as the graphs.  False without graphs.
    """
    return oracle_generation.recorded_hash() not in (None, oracle_generation.spec_hash())


def shown(verdict: models.ModelVerdict, changed: bool = False) -> str:
    """The outcome as text, with the counterexample; ``changed`` as ``specification_changed``."""
    model, result = verdict.model, verdict.result
    if result is None:
        return f"{model.cfg}: {verdict.outcome}: {verdict.problem}"
    expected = "as recorded before your change" if changed else "as expected"
    if not verdict.ok:
        expected = f"NOT as expected: {verdict.problem}"
    found = f"{result.distinct_states:,} distinct states, {result.seconds:.1f} s"
    if verdict.outcome == "holds":
        return f"{model.cfg}: every property holds; {found}; {expected}"
    head = f"{model.cfg}: {verdict.property} is violated; {found}; {expected}"
    return "\n".join([head, *steps(verdict.trace, result.loop)])


def not_covered(verdicts: Sequence[models.ModelVerdict]) -> str:
    """The warning that no model distinguishes a changed specification from the recorded one.

    Empty if a model does.  Only for use with ``specification_changed``.
    """
    if not verdicts or not all(verdict.ok for verdict in verdicts):
        return ""
    checked = "the model" if len(verdicts) == 1 else f"each of the {len(verdicts)} models"
    return (
        "No property covers what you changed: the specification differs from the one recorded in "
        f"spec/oracle, but {checked} gives exactly the recorded result. "
        "If you changed more than a comment, add a model or a property that shows the difference."
    )


def steps(trace: Sequence[tlc.TraceState], loop: int | None = None) -> list[str]:
    """One line for each step: the action, the station, its input, the rule and line that decided,
    and the changed fields."""
    lines = [f"{step.index:3}. {step.text}" for step in steps_.steps(trace)]
    if loop == len(trace):
        lines.append("     and the state stays the same for ever")
    elif loop:
        lines.append(
            f"     and from here (by a step that TLC does not name) the steps after {loop - 1} "
            "repeat for ever"
        )
    return lines


def exit_code(verdicts: Sequence[models.ModelVerdict]) -> int:
    """0 as expected, 1 not as expected, 3 if TLC gave no verdict, 4 if TLC did not finish."""
    outcomes = {verdict.outcome for verdict in verdicts}
    if "error" in outcomes:
        return 3
    if any(not verdict.ok and verdict.outcome != "incomplete" for verdict in verdicts):
        return 1
    return 4 if "incomplete" in outcomes else 0


_ENDED = {
    "time": "ended by the time limit",
    "number": "as many as requested",
    "violation": "ended by a violation",
}


def shown_walks(walks: Walks) -> str:
    """The outcome, the counterexample if there is one, and the number of steps of each rule."""
    found = f"{walks.behaviours:,} behaviours, {walks.steps:,} steps ({_ENDED[walks.ended]})"
    head = f"{walks.model.name}, seed {walks.seed}, depth {walks.depth}: {found}"
    return "\n".join([head, _walks_verdict(walks), *steps(walks.trace), *_rules(walks)])


def _walks_verdict(walks: Walks) -> str:
    breaks = walks.model.breaks
    if walks.property is not None:
        expected = "as expected" if walks.property == breaks else "NOT as expected: it must hold"
        return f"{walks.property} is violated; {expected}"
    if breaks:
        return f"cannot tell: {breaks} must be violated, but these behaviours do not violate it"
    return "no property is violated in these behaviours (this proves nothing about others)"


def _rules(walks: Walks) -> list[str]:
    counts = [f"{rule} {n:,}" for rule, n in sorted(walks.rules.items())]
    lines = ["Steps decided by each rule:"]
    for at in range(0, len(counts), 6):
        lines.append("  " + "".join(f"{count:15}" for count in counts[at : at + 6]).rstrip())
    lines.append("never: " + (" ".join(walks.never) or "none"))
    lines.append("(a CAM, or an input without effect, is not a step of a model)")
    return lines
