"""Mutation testing of the specification: finds the mutants that the models kill."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from automcm_maintenance.spec_mutation.mutants import Mutant
from automcm_spec.graph import oracle, oracle_generation
from automcm_spec.model_checking import models, tlc, toolchain
from automcm_spec.model_checking.models import PROPERTY_IDS, Model
from automcm_spec.support import scratch
from automcm_spec.support.paths import TLA

How = Literal["property", "must-fail", "probe", "graph", "evaluation", "timeout", "counts"]
HOW: dict[How, str] = {
    "property": "a property that must hold is violated",
    "must-fail": "a must-fail model violates no property, or another one",
    "probe": "a probe reaches a situation that it did not reach before, or no longer reaches one",
    "graph": "an answer of one station differs from the oracle, and so from the reference",
    "evaluation": "TLC cannot evaluate the mutant",
    "timeout": "TLC exceeds three times the time without the mutant, or its memory",
    "counts": "only the recorded numbers of states or steps differ",
}
"""The ways to kill a mutant, the most informative first."""

MUST_FAIL_COST = 4
"""The penalty for a must-fail model in the order of models: a kill by a property is more
informative."""

_WEAK: tuple[How, ...] = ("evaluation", "timeout", "counts")
GRAPHS = (oracle_generation.TIGHT, oracle_generation.ONE_PEER)
"""The graphs that are compared for a mutant of Station if no model kills it by a property."""

Profile = Literal["quick", "deep"]
Notify = Callable[[str], None]


class MutationError(Exception):
    """The run cannot continue: a tool failed, or a model fails without a mutant."""


@dataclass(frozen=True)
class Kill:
    """A kill of a mutant by a model.  ``what``: the violated property, or another difference."""

    model: str
    how: How
    what: str


@dataclass(frozen=True)
class MutantOutcome:
    """The result for a mutant.  invalid: it does not parse.  seconds: TLC's duration."""

    mutant: Mutant
    kills: tuple[Kill, ...]
    invalid: bool = False
    seconds: float = 0

    @property
    def how(self) -> How | None:
        """The most informative kill; None for a survivor and for an invalid mutant."""
        order = list(HOW)
        return min((kill.how for kill in self.kills), key=order.index, default=None)

    @property
    def survived(self) -> bool:
        """Whether no model killed it."""
        return not self.kills and not self.invalid

    @property
    def properties(self) -> list[str]:
        """The properties that killed it."""
        return sorted({kill.what for kill in self.kills if kill.how == "property"})

    def as_dict(self) -> dict[str, Any]:
        """The row for ``--json``."""
        m = self.mutant
        return {
            "id": m.id,
            "module": m.module,
            "definition": m.operator,
            "kind": m.kind,
            "line": m.line,
            "before": m.before,
            "after": m.after,
            "outcome": "invalid" if self.invalid else self.how or "survived",
            "kills": [asdict(kill) for kill in self.kills],
            "seconds": round(self.seconds, 1),
        }


@dataclass
class MutationReport:
    """The outcomes in the order of the mutants; not complete if the run was interrupted.

    problems and reasons (of survivors, by id) come from the list of survivors.
    """

    profile: Profile
    selected: int
    outcomes: list[MutantOutcome]
    problems: list[str] = field(default_factory=list)
    reasons: dict[str, str] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Whether all selected mutants have a result."""
        return len(self.outcomes) == self.selected

    @property
    def exit_code(self) -> int:
        """0 as expected, 1 not as expected, 4 if not complete."""
        return 4 if not self.complete else 1 if self.problems else 0


@dataclass(frozen=True)
class _Found:
    """The result of one run of TLC on a mutant: no difference (how is None), or its kind."""

    how: How | Literal["invalid"] | None
    what: str
    seconds: float


_KEPT = TypeAdapter(tuple[str, How | Literal["invalid"] | None, str, float])


class Cache:
    """A cache of runs with one line of JSON for each, so that an interrupted run loses nothing.

    The key of a run is a hash of all inputs of TLC and of the expected result.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._found: dict[str, _Found] = {}
        if path is not None and path.is_file():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    key, how, what, seconds = _KEPT.validate_json(line)
                except ValidationError:
                    continue  # a line that the interrupted run did not finish
                self._found[key] = _Found(how, what, seconds)

    def get(self, key: str) -> _Found | None:
        """The cached result, if there is one."""
        return self._found.get(key)

    def put(self, key: str, found: _Found) -> None:
        """Store a result."""
        with self._lock:
            if self._found.get(key) == found:
                return
            self._found[key] = found
            if self._path is not None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                with self._path.open("a", encoding="utf-8") as file:
                    row = [key, found.how, found.what, found.seconds]
                    file.write(json.dumps(row) + "\n")


class _Run:
    """The models, the cache, and the checks of one mutant."""

    def __init__(
        self,
        chosen: Sequence[Model],
        tla: Path,
        cache: Cache,
        search_s: float,
    ) -> None:
        cost = {"holds": 1, "violates": MUST_FAIL_COST}
        self.models = sorted(chosen, key=lambda m: (cost[m.expect] * m.seconds, m.cfg))
        self.stop = tlc.TlcStop()
        self._cache = cache
        self._search_s = search_s
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

    def quick(self, mutant: Mutant) -> MutantOutcome:
        """Run models until one kills the mutant.

        If only counts differ, or TLC does not finish, compare the graph of one station, and then
        run the other models that must hold and take at most search_s, for a more informative kill.
        """
        kills: list[Kill] = []
        seconds = 0.0
        graphs = mutant.module == "Station"
        with scratch.folder("mutant") as folder:
            for model in [*self._seeing(mutant), None]:
                if graphs and (kills or model is None or model.seconds > self._search_s):
                    graphs = False
                    found = self._graph(mutant, folder)
                    seconds += found.seconds
                    if found.how is not None:
                        kills.append(Kill("the oracle", "graph", found.what))
                        break
                if model is None:
                    break
                if kills and (model.expect != "holds" or model.seconds > self._search_s):
                    continue
                found = self._check(mutant, model, model.config, folder)
                seconds += found.seconds
                if found.how == "invalid":
                    return MutantOutcome(mutant, (), True, seconds)
                if found.how in _WEAK:
                    if not kills:
                        kills.append(Kill(model.cfg, found.how, found.what))
                    elif found.how == "timeout":
                        break  # the others would not finish either
                elif found.how is not None:
                    kills.append(Kill(model.cfg, found.how, found.what))
                    break
        return MutantOutcome(mutant, tuple(kills), False, seconds)

    def _graph(self, mutant: Mutant, folder: Path) -> _Found:
        """Whether the graphs of one station equal the oracles; the small one first."""
        modules = {name: self._modules[name] for name in oracle_generation.MODULES}
        modules["Station"] = mutant.apply(modules["Station"])
        for name, text in modules.items():
            (folder / f"{name}.tla").write_bytes(text)
        seconds = 0.0
        for graph in GRAPHS:
            key = hashlib.sha256(graph.name.encode() + b"".join(modules.values())).hexdigest()
            found = self._cache.get(key) or self._built(graph, folder)
            self._cache.put(key, found)
            seconds += found.seconds
            if found.how is not None:
                return _Found(found.how, found.what, seconds)
        return _Found(None, "", seconds)

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

    def deep(self, mutant: Mutant) -> MutantOutcome:
        """All properties that are violated in any model that must hold."""
        kills: list[Kill] = []
        seconds = 0.0
        with scratch.folder("mutant") as folder:
            for model in self._seeing(mutant):
                for found in self._violated(mutant, model, folder):
                    seconds += found.seconds
                    if found.how == "invalid":
                        return MutantOutcome(mutant, (), True, seconds)
                    if found.how is not None:
                        kills.append(Kill(model.cfg, found.how, found.what))
        return MutantOutcome(mutant, tuple(kills), False, seconds)

    def _seeing(self, mutant: Mutant) -> Iterator[Model]:
        return (m for m in self.models if mutant.module in self._read_by[m.module])

    def _violated(self, mutant: Mutant, model: Model, folder: Path) -> Iterator[_Found]:
        """Repeat the run without the violated property until none is violated."""
        rest, left = models.split(model.config)
        while left:
            found = self._check(mutant, model, _joined(rest, left), folder)
            ids = [PROPERTY_IDS.get(name, name) for _, name in left]
            if found.how == "property" and found.what not in ids:
                # TLC does not name a temporal property, so each is checked separately.
                for one in [x for x in left if x[0].startswith("PROPERT")]:
                    yield self._check(mutant, model, _joined(rest, [one]), folder)
                return
            yield found
            if found.how != "property":
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
        """One run of TLC, or its cached result.  folder is the mutant's own.

        A cached time-out is not used, because the machine may have been busy.
        """
        modules = {name: self._modules[name] for name in sorted(self._read_by[model.module])}
        if mutant is not None:
            modules[mutant.module] = mutant.apply(modules[mutant.module])
        expected = model.model_dump_json(exclude={"config", "seconds", "why", "profile"})
        digest = hashlib.sha256("\0".join((cfg, expected, toolchain.SHA256)).encode())
        for name, text in modules.items():
            digest.update(f"\0{name}\0".encode() + text)
        key = digest.hexdigest()
        if (known := self._cache.get(key)) is not None and known.how != "timeout":
            return known
        if self.stop.stopped:
            raise _Stopped
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
        found = _found(verdict, cfg)
        self._cache.put(key, found)
        return found


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
    if verdict.outcome == "violates" and verdict.model.expect == "holds":
        temporal = [name for word, name in models.split(cfg)[1] if word.startswith("PROPERT")]
        name = verdict.property or (temporal[0] if len(temporal) == 1 else "a temporal property")
        return _Found("property", PROPERTY_IDS.get(name, name), seconds)
    what = verdict.problem.splitlines()[0]
    if what.startswith("reached"):
        return _Found("probe", what, seconds)
    if verdict.model.expect == "holds" or verdict.property == verdict.model.property:
        return _Found("counts", what, seconds)
    return _Found("must-fail", what, seconds)


def _joined(rest: str, checked: Sequence[tuple[str, str]]) -> str:
    return "\n".join([rest, *(f"{keyword} {name}" for keyword, name in checked), ""])


def run(
    mutants: Sequence[Mutant],
    chosen: Sequence[Model],
    *,
    profile: Profile = "quick",
    tla: Path = TLA,
    cache: Path | None = None,
    jobs: int = 2,
    search_s: float = 15,
    notify: Notify = lambda text: None,
) -> MutationReport:
    """Run the models on each mutant, ``jobs`` at a time; say gets a status line.

    On Ctrl-C the active runs are killed, and the report contains the known results; the next run
    with the same cache continues.  Raises MutationError if a model is not as expected without a
    mutant, or if a tool fails.
    """
    if profile == "deep":
        chosen = [model for model in chosen if model.expect == "holds"]
    the_run = _Run(chosen, tla, Cache(cache), search_s)
    work = the_run.quick if profile == "quick" else the_run.deep
    outcomes: dict[str, MutantOutcome] = {}
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        try:
            futures = [pool.submit(work, mutant) for mutant in mutants]
            for future in as_completed(futures):
                outcome = future.result()
                outcomes[outcome.mutant.id] = outcome
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
