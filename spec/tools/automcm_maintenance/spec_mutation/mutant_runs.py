"""Mutation testing of the specification: finds the mutants that the models kill."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

from automcm_maintenance.spec_mutation.mutant_results import MutantResult
from automcm_maintenance.spec_mutation.mutant_rules import HOW, How
from automcm_maintenance.spec_mutation.mutants import Mutant
from automcm_spec.graph import oracle, oracle_generation
from automcm_spec.model_checking import models, tlc
from automcm_spec.model_checking.models import PROPERTY_IDS, Model
from automcm_spec.support import scratch
from automcm_spec.support.paths import TLA

GRAPHS = (oracle_generation.TIGHT, oracle_generation.ONE_PEER)
"""The graphs that are compared for a mutant of Station that no property kills."""
FIRST = ("completes", "restarts", "station_properties")
"""These models run first: of 40 mutants they kill 27 of the 28 that four models kill."""
TIMEOUTS = 3
"""After so many models that exceed their time, the others are not run."""

Profile = Literal["quick", "deep"]
Notify = Callable[[str], None]


class MutationError(Exception):
    """The run cannot continue: a tool failed, or a model fails without a mutant."""


@dataclass(frozen=True)
class _Found:
    """The result of one run of TLC on a mutant: no difference (how is None), or its kind."""

    how: How | Literal["invalid"] | None
    what: str
    seconds: float


@dataclass(frozen=True)
class MutantOutcome:
    """The result for a mutant.  invalid: it does not parse."""

    mutant: Mutant
    kills: tuple[_Found, ...]
    invalid: bool = False

    @property
    def survived(self) -> bool:
        """Whether no property killed it."""
        return not self.properties and not self.invalid

    @property
    def properties(self) -> list[str]:
        """The properties that killed it."""
        return sorted({kill.what for kill in self.kills if kill.how == "property"})

    @property
    def row(self) -> MutantResult:
        """It as a row of the results."""
        hows = {kill.how for kill in self.kills}
        return MutantResult(
            id=self.mutant.id,
            line=self.mutant.line,
            change=self.mutant.change,
            properties=self.properties,
            differs=[how for how in HOW if how in hows and how != "property"],
        )


@dataclass
class MutationReport:
    """The outcomes in the order of the mutants; not complete if the run was interrupted."""

    profile: Profile
    selected: int
    outcomes: list[MutantOutcome]
    before: list[MutantResult] = field(default_factory=list)
    """The results of earlier runs that still hold."""
    problems: list[str] = field(default_factory=list)
    """Those of the list of reasons."""

    @property
    def complete(self) -> bool:
        """Whether all selected mutants have a result."""
        return len(self.outcomes) == self.selected

    @property
    def rows(self) -> list[MutantResult]:
        """The mutants that parse, with those before."""
        return [*self.before, *(o.row for o in self.outcomes if not o.invalid)]

    @property
    def exit_code(self) -> int:
        """0 as expected, 1 not as expected, 4 if not complete."""
        return 4 if not self.complete else 1 if self.problems else 0


class _Run:
    """The models, and the checks of one mutant."""

    def __init__(self, chosen: Sequence[Model], tla: Path) -> None:
        self.models = sorted(chosen, key=lambda m: (m.cfg not in FIRST, m.seconds, m.cfg))
        self.stop = tlc.TlcStop()
        self._modules = {path.stem: path.read_bytes() for path in sorted(tla.glob("*.tla"))}
        self._locks = {m.cfg: threading.Lock() for m in chosen}
        self._sound: dict[str, float] = {}
        texts = {name: text.decode() for name, text in self._modules.items()}
        self._read_by = {m.module: models.extended(m.module, texts, instances=True) for m in chosen}

    def _baseline(self, model: Model) -> float:
        """The model's duration without a mutant on this machine, measured once.

        Raises MutationError if the result is not as expected.
        """
        with self._locks[model.cfg]:
            if model.cfg in self._sound:
                return self._sound[model.cfg]
            with scratch.folder("mutant") as folder:
                longest = 20 * _limit(model.seconds)
                found = self._run(None, model, model.config, folder, longest)
            if found.how is not None:
                raise MutationError(
                    f"{model.cfg} is not as expected without a mutant: {found.how}, {found.what}"
                )
            self._sound[model.cfg] = found.seconds
            return found.seconds

    def outcome(self, mutant: Mutant, deep: bool) -> MutantOutcome:
        """The first property that is violated, FIRST and the cheapest first; ``deep``: every one.

        If there is none, the graph of one station is compared as well.
        """
        kills: list[_Found] = []
        with scratch.folder("mutant") as folder:
            for model in self._seeing(mutant):
                for found in self._violated(mutant, model, folder, deep):
                    if found.how == "invalid":
                        return MutantOutcome(mutant, (), invalid=True)
                    if found.how is not None:
                        kills.append(found)
                hows = [kill.how for kill in kills]
                if ("property" in hows and not deep) or hows.count("timeout") == TIMEOUTS:
                    break
            if mutant.module == "Station" and "property" not in {kill.how for kill in kills}:
                kills += self._graph(mutant, folder)
        return MutantOutcome(mutant, tuple(kills))

    def _graph(self, mutant: Mutant, folder: Path) -> list[_Found]:
        """The difference of a graph of one station from its oracle, if any; the small one first."""
        modules = {name: self._modules[name] for name in oracle_generation.MODULES}
        modules["Station"] = mutant.apply(modules["Station"])
        for name, text in modules.items():
            (folder / f"{name}.tla").write_bytes(text)
        for graph in GRAPHS:
            found = self._built(graph, folder)
            if found.how is not None:
                return [found]
        return []

    def _built(self, graph: oracle_generation.Graph, folder: Path) -> _Found:
        started = time.monotonic()
        try:
            data, _ = oracle_generation.build(graph, tla=folder, workers=1, stop=self.stop)
        except (tlc.TlcError, ValueError, KeyError) as error:  # a mutant may print any graph
            if self.stop.stopped:
                raise _Stopped from error
            return _Found("graph", f"{graph.name} cannot be written out", 0)
        seconds = round(time.monotonic() - started, 2)
        if _answers(data) == _committed(graph):
            return _Found(None, "", seconds)
        return _Found("graph", f"{graph.name} differs", seconds)

    def _seeing(self, mutant: Mutant) -> Iterator[Model]:
        return (m for m in self.models if mutant.module in self._read_by[m.module])

    def _violated(self, mutant: Mutant, model: Model, folder: Path, deep: bool) -> Iterator[_Found]:
        """TLC's result; ``deep``: repeated without the violated property until none is violated."""
        rest, left = models.split(model.config)
        while left:
            found = self._check(mutant, model, _joined(rest, left), folder)
            ids = [PROPERTY_IDS.get(name, name) for _, name in left]
            if found.how == "property" and found.what not in ids:
                # TLC does not name a temporal property, so each is checked separately.
                temporal = [x for x in left if x[0].startswith("PROPERT")]
                each = [self._check(mutant, model, _joined(rest, [x]), folder) for x in temporal]
                yield from [one for one in each if one.how == "property"] or [found]
                return
            yield found
            if found.how != "property" or not deep:
                return
            del left[ids.index(found.what)]

    def _check(self, mutant: Mutant, model: Model, cfg: str, folder: Path) -> _Found:
        """TLC's result on a mutant; a difference counts if the unmutated model is as expected.

        If TLC does not finish, and the model is slower on this machine than recorded, it gets more
        time.
        """
        found = self._run(mutant, model, cfg, folder, _limit(model.seconds))
        if found.how is not None:
            seconds = self._baseline(model)
            if found.how == "timeout" and seconds > model.seconds:
                return self._run(mutant, model, cfg, folder, _limit(seconds))
        return found

    def _run(
        self, mutant: Mutant | None, model: Model, cfg: str, folder: Path, timeout_s: float
    ) -> _Found:
        """One run of TLC; folder is the mutant's own."""
        if self.stop.stopped:
            raise _Stopped
        modules = {name: self._modules[name] for name in self._read_by[model.module]}
        if mutant is not None:
            modules[mutant.module] = mutant.apply(modules[mutant.module])
        for name, text in modules.items():
            (folder / f"{name}.tla").write_bytes(text)
        verdict = models.check(
            model.model_copy(update={"config": cfg}),
            tla_dir=folder,
            timeout_s=timeout_s,
            stop=self.stop,
        )
        if self.stop.stopped:
            raise _Stopped
        return _found(verdict, cfg)


def _limit(seconds: float) -> float:
    """The time limit for a mutant, from the duration without a mutant."""
    return 3 * seconds + 10


def _answers(data: dict[str, Any]) -> str:
    """An oracle without the version of its specification."""
    return json.dumps({k: v for k, v in data.items() if k != "spec_hash"}, sort_keys=True)


@cache
def _committed(graph: oracle_generation.Graph) -> str:
    return _answers(json.loads(oracle.content(graph.path)))


class _Stopped(Exception):
    """The run is being interrupted."""


def _found(verdict: models.ModelVerdict, cfg: str) -> _Found:
    if verdict.error is not None:
        error = verdict.error
        if error.kind in ("java", "disk"):
            raise MutationError(str(error))
        known: dict[str, How | Literal["invalid"]]
        known = {"parse": "invalid", "timeout": "timeout", "memory": "timeout"}
        return _Found(known.get(error.kind, "evaluation"), str(error).splitlines()[0], 0)
    assert verdict.result is not None
    seconds = round(verdict.result.seconds, 2)
    if verdict.problem is None:
        return _Found(None, "", seconds)
    if verdict.outcome == "violates":
        temporal = [name for word, name in models.split(cfg)[1] if word.startswith("PROPERT")]
        name = verdict.property or (temporal[0] if len(temporal) == 1 else "a temporal property")
        return _Found("property", PROPERTY_IDS.get(name, name), seconds)
    what = verdict.problem.splitlines()[0]
    probe = what.startswith(("reached", "no longer reached"))
    return _Found("probe" if probe else "counts", what, seconds)


def _joined(rest: str, checked: Sequence[tuple[str, str]]) -> str:
    return "\n".join([rest, *(f"{keyword} {name}" for keyword, name in checked), ""])


def run(
    mutants: Sequence[Mutant],
    chosen: Sequence[Model],
    *,
    profile: Profile = "quick",
    tla: Path = TLA,
    jobs: int = 2,
    notify: Notify = lambda text: None,
    keep: Callable[[MutantOutcome], None] = lambda outcome: None,
) -> MutationReport:
    """Run the models, which must hold, on each mutant, ``jobs`` at a time; ``keep`` gets each
    outcome at once.

    On Ctrl-C the active runs are killed, and the report contains the known results.  Raises
    MutationError if a model is not as expected without a mutant, or if a tool fails.
    """
    the_run = _Run(chosen, tla)
    outcomes: dict[str, MutantOutcome] = {}
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        try:
            futures = [
                pool.submit(the_run.outcome, mutant, profile == "deep") for mutant in mutants
            ]
            for future in as_completed(futures):
                outcome = future.result()
                outcomes[outcome.mutant.id] = outcome
                keep(outcome)
                survived = sum(o.survived for o in outcomes.values())
                notify(f"{len(outcomes)} of {len(mutants)} mutants, {survived} survived")
        except KeyboardInterrupt:
            the_run.stop.now()
            pool.shutdown(cancel_futures=True)
        except BaseException:
            the_run.stop.now()
            pool.shutdown(cancel_futures=True)
            raise
    return MutationReport(
        profile, len(mutants), [outcomes[m.id] for m in mutants if m.id in outcomes]
    )
