"""Checks models, several at a time; must-fail models that differ in operators alone share a run.

A run of TLC takes half a second before it checks anything. In a shared run the variable ``taken``
names the model, an operator that the models replace asks it which version counts, and the state
spaces lie side by side. TLC goes on after a violation (-continue), but not in the model that it has
shown to break. Breadth first, each model breaks where it does in a run of its own, so its
counterexample is the same.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path

from automcm_spec.model_checking import models, tlc
from automcm_spec.model_checking.models import COMMENT, Model, ModelVerdict
from automcm_spec.support import scratch
from automcm_spec.support.paths import TLA

_APART = (*models.LIVENESS, "R-1")
"""Properties of another form than an invariant or [][Action]_variables."""
_PREFIX = "Of"
_BROKEN, _OVER = 9001, 9002
"""Registers of TLC that no module uses: the models that are broken, and those not to go on with."""

_SPEC = re.compile(r"\s*(.*?)/\\\s*\[\]\[\s*(\w+)\s*\]_(\w+|<<.*?>>)\s*", re.DOTALL)
_BOX = re.compile(r"(?:.*/\\)?(\s*)\[\]\[(.*)\]_(\w+|<<[^>]*>>)\s*", re.DOTALL)
_FIXED = re.compile(r"^(?:CONSTANTS?|ASSUME)\b.*?(?=^\S|\Z)", re.MULTILINE | re.DOTALL)
_LINE = re.compile(r"^(SPECIFICATION|VIEW) +(\w+) *$", re.MULTILINE)
_TAKEN = re.compile(r'^/\\ taken = ".*"$', re.MULTILINE)


class _Unsupported(ValueError):
    """A model whose specification or property has a form that cannot share a run."""


def runs(chosen: Sequence[Model], tla_dir: Path = TLA) -> list[list[Model]]:
    """The models by run: those that must break a safety property share one if their cfgs differ in
    replaced definitions alone; any other has its own.

    TLC evaluates constants and assumptions before there is a state, so ``taken`` cannot choose
    them.
    """
    texts = "\n".join(path.read_text(encoding="utf-8") for path in tla_dir.glob("*.tla"))
    fixed = set(re.findall(r"\w+", " ".join(_FIXED.findall(COMMENT.sub("", texts)))))
    found: dict[object, list[Model]] = {}
    for model in chosen:
        key: object = model.cfg
        if model.breaks is not None and model.property not in _APART:
            lines = models.split(model.config)[0].split("\n")
            same = [x for x in lines if x.strip() and ("<-" not in x or x.split()[0] in fixed)]
            key = (model.module, *sorted(same))
        found.setdefault(key, []).append(model)
    return list(found.values())


def check_all(
    chosen: Sequence[Model],
    *,
    on_done: Callable[[ModelVerdict], None],
    tla_dir: Path = TLA,
    stop: tlc.TlcStop | None = None,
) -> None:
    """Check the models, several at a time, the longest first.

    on_done is called in the calling thread as each one ends. If it raises, or on Ctrl-C, the
    remaining runs are killed.
    """
    order = sorted(runs(chosen, tla_dir), key=lambda run: -sum(model.seconds for model in run))
    stop = stop or tlc.TlcStop()
    with ThreadPoolExecutor(max_workers=3) as pool:  # keeps two cores busy
        futures = [pool.submit(_check, run, tla_dir, stop) for run in order]
        try:
            for future in as_completed(futures):
                for verdict in future.result():
                    on_done(verdict)
        except BaseException:
            for future in futures:
                future.cancel()
            stop.now()
            raise


def _check(run: Sequence[Model], tla_dir: Path, stop: tlc.TlcStop) -> list[ModelVerdict]:
    """The verdicts on the models of a run. Where a shared one is not as expected, the run of the
    model alone decides, and tells why."""
    shared = {} if len(run) == 1 else _shared(run, tla_dir, stop)
    return [
        verdict
        if (verdict := shared.get(model.cfg)) is not None and verdict.ok
        else models.check(model, tla_dir=tla_dir, stop=stop)
        for model in run
    ]


def _shared(run: Sequence[Model], tla_dir: Path, stop: tlc.TlcStop) -> dict[str, ModelVerdict]:
    """The verdicts on the models that a shared run has shown to break; none if TLC fails."""
    broken: dict[str, tuple[tlc.TraceState, ...]] = {}

    def violated(name: str | None, trace: Sequence[tlc.TraceState]) -> None:
        broken[(name or "").removeprefix(_PREFIX)] = tuple(map(_alone, trace))

    try:
        texts = {path.stem: path.read_text(encoding="utf-8") for path in tla_dir.glob("*.tla")}
        module, cfg = shared_model(run, texts)
        with scratch.folder("shared") as folder:
            for path in tla_dir.glob("*.tla"):
                shutil.copy(path, folder)
            (folder / "Shared.tla").write_text(module, encoding="utf-8")
            (folder / "Shared.cfg").write_text(cfg, encoding="utf-8")
            found = tlc.run(
                "Shared",
                folder / "Shared.cfg",
                tla_dir=folder,
                extra=("-continue",),
                on_violation=violated,
                stop=stop,
                short=True,
            )
    except (tlc.TlcError, _Unsupported, OSError):
        return {}
    found = replace(found, outcome="violates", seconds=found.seconds / len(run))
    return {
        model.cfg: models.judged(
            model, replace(found, property=model.breaks, trace=broken[model.cfg]), ()
        )
        for model in run
        if model.cfg in broken
    }


def _alone(state: tlc.TraceState) -> tlc.TraceState:
    """The state as in a run of its model alone."""
    text = _TAKEN.sub("", state.text)
    return tlc.TraceState(state.index, state.action.removeprefix(_PREFIX), text)


def shared_model(run: Sequence[Model], texts: Mapping[str, str]) -> tuple[str, str]:
    """The module and the cfg of a shared run. Raises _Unsupported."""
    first = run[0]
    read = models.extended(first.module, texts)
    known = _definitions(COMMENT.sub("", "\n".join(texts[name] for name in sorted(read))))
    known = {name: _apart(*definition) for name, definition in known.items()}
    rest, _ = models.split(first.config)
    named = dict(_LINE.findall(rest))
    init, next_, variables = _specification(known, named["SPECIFICATION"])
    replaced = {model.cfg: models.replaced_in(model.config) for model in run}
    names = sorted({name for by in replaced.values() for name in by})
    lines = ["---- MODULE Shared ----", f"EXTENDS {first.module}, TLC", "VARIABLE taken"]
    substitutions = []
    for name in names:
        by = {cfg: made[name] for cfg, made in replaced.items() if name in made}
        if len(by) == len(run) and len(set(by.values())) == 1:
            substitutions.append(f"  {name} <- {next(iter(by.values()))}")
            continue
        parameters, body = known[name]
        arms = [f'taken = "{cfg}" -> {other}{parameters}' for cfg, other in by.items()]
        if len(by) < len(run):
            lines.append(f"Own{name}{parameters} ==\n{body}")
            arms.append(f"OTHER -> Own{name}{parameters}")
        lines.append(f"Any{name}{parameters} == CASE {' [] '.join(arms)}")
        substitutions.append(f"  {name} <- Any{name}")
    quoted = ", ".join(f'"{model.cfg}"' for model in run)
    lines += [
        f"ASSUME TLCSet({_BROKEN}, {{}}) /\\ TLCSet({_OVER}, {{}})",
        f"Unbroken == taken \\notin TLCGet({_OVER}) /\\ taken' = taken",
        *_actions(next_, known),
        f"SharedInit == taken \\in {{{quoted}}} /\\ {init}",
        f"SharedSpec == SharedInit /\\ [][{_PREFIX}{next_}]_<<{variables}, taken>>",
        f"SharedView == <<{named.get('VIEW', variables)}, taken>>",
        f"Broken == TLCGet({_BROKEN})",
        f"Going == taken \\notin Broken \\/ (TLCSet({_OVER}, Broken) /\\ FALSE)",
    ]
    checks = []
    for model in run:
        keyword, text = _broken(model, known, variables)
        lines.append(text)
        checks.append(f"{keyword} {_PREFIX}{model.cfg}")
    constants = [line for line in rest.splitlines() if line.startswith("  ") and "<-" not in line]
    cfg = ["CONSTANTS", *constants, *substitutions, "SPECIFICATION SharedSpec", "VIEW SharedView"]
    cfg += ["CONSTRAINT Going", *checks, "CHECK_DEADLOCK FALSE", ""]
    return "\n".join([*lines, "====", ""]), "\n".join(cfg)


def _definitions(text: str) -> dict[str, tuple[str, str]]:
    """The operators of modules: the parameters in parentheses, and the body, which keeps its
    columns."""
    heads = list(re.finditer(r"^(\w+)(\([^=\n]*\))? *==", text, re.MULTILINE))
    found = {}
    for head in heads:
        body = re.match(r".*\n?(?:[ \t].*\n?|\n)*", text[head.end() :])
        assert body is not None
        found[head[1]] = head[2] or "", " " * len(head[0]) + body[0].rstrip()
    return found


def _apart(parameters: str, body: str) -> tuple[str, str]:
    """A definition with a parameter ``st`` as one with ``ST``, because a variable has the name."""
    own = re.compile(r"(?<![.\w])st\b(?! *\|->)")  # not a field
    if not own.search(parameters):
        return parameters, body
    return own.sub("ST", parameters), own.sub("ST", body)


def _specification(known: Mapping[str, tuple[str, str]], name: str) -> tuple[str, str, str]:
    """Init, Next and the variables of a formula Init /\\ [][Next]_variables."""
    found = _SPEC.fullmatch(known[name][1])
    if found is None:
        raise _Unsupported(f"{name} is not Init /\\ [][Next]_variables")
    return " ".join(found[1].split()), found[2], found[3]


def _actions(name: str, known: Mapping[str, tuple[str, str]]) -> list[str]:
    """A next-state relation that keeps ``taken``. Its actions have the prefix, because TLC names
    them in a counterexample."""
    _, body = known[name]
    words = [word for word in dict.fromkeys(re.findall(r"\w+", body)) if word in known]
    lines = []
    for word in words:
        parameters = known[word][0]
        if "Next" in word:
            lines += _actions(word, known)
        else:
            lines.append(f"{_PREFIX}{word}{parameters} == Unbroken /\\ {word}{parameters}")
    prefixed = re.sub(rf"\b({'|'.join(words)})\b", rf"{_PREFIX}\1", body)
    return [*lines, f"{_PREFIX}{name} ==\n{prefixed}"]


def _broken(model: Model, known: Mapping[str, tuple[str, str]], variables: str) -> tuple[str, str]:
    """The check of a model: what must break, and what it says when it does."""
    assert model.breaks is not None
    once = f'TLCSet({_BROKEN}, Broken \\cup {{"{model.cfg}"}}) /\\ FALSE'
    other = f'taken # "{model.cfg}" \\/ "{model.cfg}" \\in Broken'
    name = f"{_PREFIX}{model.cfg}"
    if model.breaks.endswith("Inv"):
        return "INVARIANT", f"{name} == {other} \\/ {model.breaks} \\/ ({once})"
    found = _BOX.fullmatch(known[model.breaks][1])
    if found is None:
        raise _Unsupported(f"{model.breaks} is not [][Action]_variables")
    blanks, action, unchanged = found.groups()
    holds = f"(\n{blanks}   {action}\n) \\/ UNCHANGED {unchanged}"
    return "PROPERTY", f"{name} == [][{other} \\/ {holds} \\/ ({once})]_<<{variables}, taken>>"
