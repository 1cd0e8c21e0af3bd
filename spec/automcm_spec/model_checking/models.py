"""The models: their expected results, and whether TLC confirms them."""

import builtins
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    computed_field,
    model_validator,
)

from automcm_spec.model_checking import tlc
from automcm_spec.support import files, scratch
from automcm_spec.support.bad_input import errors_of
from automcm_spec.support.paths import MODELS, TLA

LIST = "models.toml"

#: The properties: id in docs/protocol.md and name in the modules of spec/tla.
PROPERTIES = {
    "S-1": "OneSessionProp",
    "S-2": "CommitmentProp",
    "S-3": "AcceptedInv",
    "S-4": "AgreementInv",
    "S-5": "NoHazardInv",
    "S-6": "AckedProp",
    "S-7": "NoCrossEffectProp",
    "S-8": "ExclusiveInv",
    "S-9": "ToldProp",
    "S-10": "ReasonProp",
    "S-11": "WordProp",
    "S-12": "ParticipantsInv",
    "S-13": "KeptProp",
    "S-14": "AnewProp",
    "S-15": "RememberedProp",
    "S-16": "EndedProp",
    "S-17": "OnceInv",
    "S-18": "NewerProp",
    "S-19": "LeavingProp",
    "S-20": "WithdrawnProp",
    "S-21": "EffectProp",
    "S-22": "DecidingInv",
    "N-1": "N1Prop",
    "N-2": "N2Prop",
    "N-3": "N3Prop",
    "I-1": "Inv",
    "P-1": "ProjectionProp",
    "L-1": "EndsProp",
    "L-2": "CompletesProp",
    "L-3": "SilenceProp",
    "L-4": "GivenUpProp",
    "R-1": "PromiseProp",
    "R-2": "FulfilledProp",
    "T-1": "DurationInv",
    "T-2": "HazardInv",
    "T-3": "SendingsInv",
    "T-4": "LeaseInv",
    "T-5": "OrdersInv",
    "T-6": "OneWordInv",
    "T-7": "TogetherInv",
    "T-8": "CamLossInv",
    "T-9": "LeftInv",
    "TypeInv": "TypeInv",
}

#: The properties of System, which each model of it checks; together they are called S.
SAFETY = tuple(f"S-{n}" for n in range(1, 9))

#: The properties of behaviours that never end, which TLC checks by their fairness.
LIVENESS = ("L-1", "L-2", "L-3", "L-4", "R-2")

#: The modules of one station in an arbitrary environment.
ALONE = ("Independence", "OpenStation", "ProbeStation", "StationProperties")

#: The modules with an attacker, who sends forged messages.
ATTACKED = ("Attacker", "TimedAttacker", "AttackedTogether", "AttackedLiveness", "Projection")

#: The id of a property by its name in the modules, or by the name of its timed version or of the
#: one among the stations whose keys an attacker does not have.
PROPERTY_IDS = {name: id_ for id_, name in PROPERTIES.items()} | {
    "SettledHazardInv": "S-5",
    "LoyalAckedProp": "S-6",
    "LoyalPromiseProp": "R-1",
    "LoyalFulfilledProp": "R-2",
}

#: The profiles; each includes the models of the previous ones.
PROFILES = ("quick", "full", "deep")

#: A run of fewer seconds is too short for Java to optimise it well.
SHORT_S = 5.0

_SENTENCE = re.compile(r"[.?!](?=\s|$)")
_REACHED = re.compile(r'"<<\\"REACHED\\", \\"(.+)\\">>"')
_KEYWORD = re.compile(r"^\s*([A-Z_]{4,})\b", re.MULTILINE)
COMMENT = re.compile(r"\\\*[^\n]*|\(\*.*?\*\)", re.DOTALL)
_CHECKED = {"INVARIANT", "INVARIANTS", "PROPERTY", "PROPERTIES"}
_EXTENDS = re.compile(r"\bEXTENDS\s+(\w+(?:\s*,\s*\w+)*)")
_INSTANCE = re.compile(r"\bINSTANCE\s+(\w+)")


class ModelError(Exception):
    """The list of models and the files are inconsistent, or a model has no random walks."""


class Model(BaseModel):
    """A cfg and its expected result: a pass with these counts, or a counterexample.

    config is the text of the cfg: of the file with the model's name, or of the one of its base with
    the lines in ``changes``. A model with ``breaks`` must violate that property, and checks no
    other; its why tells its story in two sentences, and length is the number of states of the
    counterexample. reaches lists all that a passing model must print as reached (modules Probe and
    TimedSystem). seconds are of a processor.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    cfg: str = Field(pattern=r"^[a-z][a-z0-9_]*$")
    module: str
    config: str
    base: str | None = None
    changes: list[str] = []
    checks: list[str] = []
    profile: Literal["quick", "full", "deep"]
    why: str = Field(min_length=1)
    seconds: float = Field(default=1.0, ge=0)
    reaches: list[str] | None = None
    distinct_states: int | None = None
    states: int | None = None
    depth: int | None = None
    breaks: str | None = None
    length: int | None = None

    @computed_field  # type: ignore[prop-decorator]
    @builtins.property
    def expect(self) -> Literal["holds", "violates"]:
        """What TLC must find."""
        return "holds" if self.breaks is None else "violates"

    @computed_field  # type: ignore[prop-decorator]
    @builtins.property
    def property(self) -> str | None:
        """The id of the property that must break."""
        return None if self.breaks is None else PROPERTY_IDS[self.breaks]

    @model_validator(mode="after")
    def _fields_fit(self) -> "Model":
        if self.breaks is not None and self.breaks not in PROPERTY_IDS:
            raise ValueError(f"breaks: {self.breaks} is not the name of a property")
        counts, length = ("distinct_states", "states", "depth"), ("length",)
        holds, violates = (*counts, "reaches", "checks"), length
        needed, barred = (counts, violates) if self.breaks is None else (length, holds)
        if self.expect == "violates" and len(_SENTENCE.findall(self.why)) != 2:
            raise ValueError("why: must be two sentences in a model that violates")
        for name in needed:
            if getattr(self, name) is None:
                raise ValueError(f"{name}: required in a model that {self.expect}")
        for name in barred:
            if getattr(self, name):
                raise ValueError(f"{name}: not allowed in a model that {self.expect}")
        return self


@dataclass(frozen=True)
class ModelVerdict:
    """TLC's result for a model, compared with the expected one.

    problem describes the difference; None if there is none. With the outcome "error", TLC gave no
    verdict: error is the reason, and result is None. "incomplete" is an error after part of the
    states had been checked without a violation (time, memory or disk ran out): partial counts them.
    property is the id of the violated property, or its TLA+ name if it has no id. reached is what
    the model printed as reached. kept: the result is from an earlier run.
    """

    model: Model
    outcome: Literal["holds", "violates", "incomplete", "error"]
    property: str | None
    result: tlc.TlcResult | None
    problem: str | None
    error: tlc.TlcError | None = None
    reached: tuple[str, ...] = ()
    kept: bool = False

    @builtins.property
    def ok(self) -> bool:
        """Whether the result is as expected."""
        return self.problem is None

    @builtins.property
    def partial(self) -> tlc.Progress | None:
        """The progress of TLC, if it was stopped."""
        return self.error.partial if self.error else None

    @builtins.property
    def trace(self) -> tuple[tlc.TraceState, ...]:
        """The counterexample; empty if there is none."""
        return self.result.trace if self.result else ()


def load(models_dir: Path = MODELS, tla_dir: Path = TLA) -> list[Model]:
    """The models of a folder, in the order of its list.

    Raises ModelError if the list or a cfg cannot be read, if an entry contains an unknown key or a
    change that changes nothing, if a model has neither a cfg nor a base, or if a name does not
    exist.
    """
    path = models_dir / LIST
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        files = {p.stem: p.read_text(encoding="utf-8") for p in sorted(models_dir.glob("*.cfg"))}
    except OSError as error:
        raise ModelError(f"{LIST} or a cfg cannot be read: {error}") from error
    except ValueError as error:
        raise ModelError(f"{LIST}: {error}") from error
    for name in sorted(set(files) - set(table)):
        raise ModelError(f"{name}.cfg is not listed in {LIST}")
    models = [_model(name, entry, table, files) for name, entry in table.items()]
    _check_names(models, tla_dir)
    return models


def _model(name: str, entry: Any, table: Mapping[str, Any], files: Mapping[str, str]) -> Model:
    where = f"{LIST}: {name}"
    if not isinstance(entry, dict):
        raise ModelError(f"{where}: must be a table, as in [{name}]")
    base = entry.get("base", name)
    if base not in files:
        raise ModelError(f"{where}: there is no {base}.cfg; base must name a model that has one")
    if base != name and name in files:
        raise ModelError(f"{where}: has a base, and a {name}.cfg")
    given = {"module": table[base].get("module")} | entry
    try:
        found = Model.model_validate(given | {"cfg": name, "config": files[base]})
        return found.model_copy(update={"config": _config(found)})
    except ValidationError as error:
        faults = "; ".join(": ".join(filter(None, each)) for each in errors_of(error))
        raise ModelError(f"{where}: {faults}") from error
    except ValueError as error:
        raise ModelError(f"{where}: {error}") from error


def _config(model: Model) -> str:
    """The cfg of a model, from that of its base. Raises ValueError for a change without effect."""
    lines = model.config.splitlines()
    for change in model.changes:
        word = change.split()[0]
        line = change if word.isupper() else f"  {change}"
        at = next((n for n, old in enumerate(lines) if old.split()[:1] == [word]), None)
        if at is not None:
            if lines[at] == line:
                raise ValueError(f"changes: {change} is what {model.base}.cfg says")
            lines[at] = line
        else:
            constants = list(takewhile(lambda old: old.startswith("  "), lines[1:]))
            lines.insert(len(lines) if word.isupper() else 1 + len(constants), line)
    if names := model.checks or ([] if model.breaks is None else [model.breaks]):
        lines = split("\n".join(lines))[0].splitlines()
        lines += [f"{'INVARIANT' if n.endswith('Inv') else 'PROPERTY'} {n}" for n in names]
    return "".join(f"{line}\n" for line in lines if line.strip())


def _check_names(models: list[Model], tla_dir: Path) -> None:
    try:
        texts = [path.read_text(encoding="utf-8") for path in sorted(tla_dir.glob("*.tla"))]
    except OSError as error:
        raise ModelError(f"cannot read a module: {error}") from error
    defined = set(re.findall(r"^(\w+) +==", "\n".join(texts), re.MULTILINE))
    for name in PROPERTIES.values():
        if name not in defined:
            raise ModelError(f"no module defines the property {name}")
    for model in models:
        if not (tla_dir / f"{model.module}.tla").is_file():
            raise ModelError(f"model {model.cfg}: module {model.module} does not exist")
        if not checked_in(model.config):
            raise ModelError(f"model {model.cfg} checks nothing")


def split(cfg: str) -> tuple[str, list[tuple[str, str]]]:
    """The text of a cfg without comments and checks, and its checks as (keyword, name)."""
    rest, *sections = _KEYWORD.split(COMMENT.sub("", cfg))
    checked: list[tuple[str, str]] = []
    for keyword, body in zip(sections[::2], sections[1::2], strict=True):
        if keyword in _CHECKED:
            checked += [(keyword, name) for name in body.split()]
        else:
            rest += f"\n{keyword}{body}"
    return rest, checked


def checked_in(cfg: str) -> list[str]:
    """The names of the invariants and properties that the text of a cfg lists."""
    return [name for _, name in split(cfg)[1]]


def replaced_in(cfg: str) -> dict[str, str]:
    """The operators that the text of a cfg replaces, each with its replacement."""
    return dict(re.findall(r"(\w+) <- (\w+)", cfg))


def extended(module: str, texts: Mapping[str, str], *, instances: bool = False) -> set[str]:
    """The modules that a module extends, directly or indirectly, including itself.

    texts are the available modules; others, such as Naturals, are left out. With instances,
    instantiated modules are included: all that TLC reads.
    """
    found: set[str] = set()
    left = {module}
    while left:
        name = left.pop()
        found.add(name)
        text = COMMENT.sub(" ", texts.get(name, ""))
        names = {one for listed in _EXTENDS.findall(text) for one in re.findall(r"\w+", listed)}
        if instances:
            names |= set(_INSTANCE.findall(text))
        left |= (names & set(texts)) - found
    return found


def of_profile(models: Sequence[Model], profile: str) -> list[Model]:
    """The models of a profile and of the previous profiles."""
    return [m for m in models if PROFILES.index(m.profile) <= PROFILES.index(profile)]


def written(model: Model, folder: Path) -> Path:
    """Write the cfg of a model into a folder and return its path."""
    path = folder / f"{model.cfg}.cfg"
    files.write(path, model.config)
    return path


def check(
    model: Model,
    *,
    tla_dir: Path = TLA,
    heap_mb: int | None = None,
    timeout_s: float | None = None,
    on_progress: Callable[[tlc.Progress], None] | None = None,
    stop: tlc.TlcStop | None = None,
) -> ModelVerdict:
    """Run TLC on a model, with one worker, and compare the result with the expected one.

    With more workers, the depth differs from run to run, and with SYMMETRY also the number of
    states.
    """
    reached: list[str] = []

    def printed(line: str) -> None:
        if match := _REACHED.fullmatch(line.strip()):
            reached.append(match[1])

    try:
        with scratch.folder("model") as folder:
            result = tlc.run(
                model.module,
                written(model, folder),
                tla_dir=tla_dir,
                extra=("-lncheck", "final"),
                heap_mb=heap_mb,
                timeout_s=timeout_s,
                on_progress=on_progress,
                on_print=printed,
                stop=stop,
                short=model.seconds < SHORT_S,
            )
    except tlc.TlcError as error:
        if error.partial and error.kind in ("timeout", "memory", "disk"):
            seen = f"incomplete: {error.partial.distinct_states:,} states checked"
            return ModelVerdict(model, "incomplete", None, None, f"{seen}; {error}", error)
        return ModelVerdict(model, "error", None, None, f"TLC gave no verdict: {error}", error)
    return judged(model, result, reached)


def judged(model: Model, result: tlc.TlcResult, reached: Sequence[str]) -> ModelVerdict:
    """TLC's result for a model, compared with the expected one."""
    name = result.property
    if name and name.startswith("line "):
        name = None  # a part of a property, identified by its place
    if name is None and result.outcome == "violates" and model.expect == "violates":
        name = model.breaks  # the cfg lists only this one
    violated = None if name is None else PROPERTY_IDS.get(name, name)
    labels = tuple(sorted(set(reached)))
    problem = _problem(model, result, violated, labels)
    return ModelVerdict(model, result.outcome, violated, result, problem, reached=labels)


def _problem(
    model: Model, result: tlc.TlcResult, violated: str | None, reached: tuple[str, ...]
) -> str | None:
    wrong: list[str] = []
    if model.expect == "holds":
        if result.outcome == "violates":
            return f"{violated or 'a temporal property'} is violated; expected no violation"
        counts = ("distinct_states", "states", "depth")
        found = {name: getattr(result, name) for name in counts}
        if missed := sorted(set(model.reaches or ()) - set(reached)):
            wrong.append(f"no longer reached: {', '.join(missed)}")
        if new := sorted(set(reached) - set(model.reaches or ())):
            wrong.append(f"reached unexpectedly: {', '.join(new)}")
    else:
        if result.outcome == "holds":
            return f"nothing is violated; expected a violation of {model.property}"
        if violated != model.property:
            return f"{violated} is violated; expected a violation of {model.property}"
        found = {"length": len(result.trace)}
    wrong += [
        f"{name} is {value}, expected {getattr(model, name)}"
        for name, value in found.items()
        if value != getattr(model, name)
    ]
    return "; ".join(wrong) or None
