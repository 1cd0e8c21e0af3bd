"""Mutation testing of the specification: which mutants the models find, and how."""

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
from automcm_spec.support.paths import MODELS, TLA

How = Literal["property", "must-fail", "probe", "graph", "evaluation", "timeout", "counts"]
HOW: dict[How, str] = {
    "property": "a property that must hold is violated",
    "must-fail": "a must-fail model breaks nothing, or another property",
    "probe": "a situation is reached that was not, or no longer",
    "graph": "what one station answers differs from the oracle, and so from the reference",
    "evaluation": "TLC cannot evaluate the mutant",
    "timeout": "TLC does not end: three times as long as without the mutant, or no memory left",
    "counts": "nothing but the recorded numbers of states or steps differ",
}
"""How a mutant may be killed, the most telling first."""

MUST_FAIL_COST = 4
"""By how much a must-fail model comes later than a model as long that must hold: the kill by a
property tells more."""

_WEAK: tuple[How, ...] = ("evaluation", "timeout", "counts")
GRAPHS = (oracle_generation.TIGHT, oracle_generation.ONE_PEER)
"""The graphs a mutant of Station is held against if the models say little or nothing of it."""

Profile = Literal["quick", "deep"]
Say = Callable[[str], None]


class MutationError(Exception):
    """The run cannot go on: a tool failed, or the models do not fit the specification as it is."""


@dataclass(frozen=True)
class Kill:
    """That a model found a mutant. what is the property violated, or what else differs."""

    model: str
    how: How
    what: str


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant. invalid: it does not parse. seconds: those of TLC, once spent."""

    mutant: Mutant
    kills: tuple[Kill, ...]
    invalid: bool = False
    seconds: float = 0

    @property
    def how(self) -> How | None:
        """The most telling kill; None for a survivor and for an invalid mutant."""
        order = list(HOW)
        return min((kill.how for kill in self.kills), key=order.index, default=None)

    @property
    def survived(self) -> bool:
        """Has no model noticed it?"""
        return not self.kills and not self.invalid

    @property
    def properties(self) -> list[str]:
        """The properties that killed it."""
        return sorted({kill.what for kill in self.kills if kill.how == "property"})

    def as_dict(self) -> dict[str, Any]:
        """As in ``--json``."""
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
class Report:
    """The outcomes in the order of the mutants; not complete if the run was interrupted.

    problems and reasons (of survivors, by id) come from the list of survivors.
    """

    profile: Profile
    selected: int
    outcomes: list[Outcome]
    problems: list[str] = field(default_factory=list)
    reasons: dict[str, str] = field(default_factory=dict)

    @property
    def complete(self) -> bool:
        """Have all that were selected been judged?"""
        return len(self.outcomes) == self.selected

    @property
    def exit_code(self) -> int:
        """0 as expected, 1 not, 4 if some are left."""
        return 4 if not self.complete else 1 if self.problems else 0


@dataclass(frozen=True)
class _Found:
    """What one run of TLC said of a mutant: nothing (how is None), or how it differs."""

    how: How | Literal["invalid"] | None
    what: str
    seconds: float


_KEPT = TypeAdapter(tuple[str, How | Literal["invalid"] | None, str, float])


class Cache:
    """The runs done so far, a line of JSON each, so that an interrupted run loses nothing.

    The key of a run is the hash of all that TLC reads and of what is expected.
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
                    continue  # the line that was being written when the run ended
                self._found[key] = _Found(how, what, seconds)

    def get(self, key: str) -> _Found | None:
        """What was found before, if anything."""
        return self._found.get(key)

    def put(self, key: str, found: _Found) -> None:
        """Keep what was found."""
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
    """The models, the cache, and how one mutant is held against them."""

    def __init__(
        self,
        chosen: Sequence[Model],
        tla: Path,
        models_dir: Path,
        cache: Cache,
        search_s: float,
    ) -> None:
        cost = {"holds": 1, "violates": MUST_FAIL_COST}
        self.models = sorted(chosen, key=lambda m: (cost[m.expect] * m.seconds, m.cfg))
        self.stop = tlc.Stop()
        self._cache = cache
        self._search_s = search_s
        self._cfg = {
            m.cfg: (models_dir / f"{m.cfg}.cfg").read_text(encoding="utf-8") for m in chosen
        }
        self._modules = {path.stem: path.read_bytes() for path in sorted(tla.glob("*.tla"))}
        self._locks = {m.cfg: threading.Lock() for m in chosen}
        self._sound: dict[str, float] = {}
        texts = {name: text.decode() for name, text in self._modules.items()}
        self._read_by = {m.module: models.extended(m.module, texts, instances=True) for m in chosen}

    def _baseline(self, model: Model) -> float:
        """How long the model takes without a mutant, on this machine as it is (measured once).

        Raises MutationError if it is not as expected.
        """
        with self._locks[model.cfg]:
            if model.cfg in self._sound:
                return self._sound[model.cfg]
            with scratch.folder("mutant") as folder:
                longest = 20 * _limit(model.seconds)
                found = self._run(None, model, self._cfg[model.cfg], folder, longest)
            if found.how is not None:
                raise MutationError(
                    f"{model.cfg} is not as expected without a mutant: {found.how}, {found.what}"
                )
            self._sound[model.cfg] = found.seconds
            return found.seconds

    def quick(self, mutant: Mutant) -> Outcome:
        """Until something kills it.

        If nothing but counts differ, or TLC does not end, the graph of one station is looked at,
        and then the other models that must hold and take no longer than search_s, for a kill
        that tells more.
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
                found = self._check(mutant, model, self._cfg[model.cfg], folder)
                seconds += found.seconds
                if found.how == "invalid":
                    return Outcome(mutant, (), True, seconds)
                if found.how in _WEAK:
                    if not kills:
                        kills.append(Kill(model.cfg, found.how, found.what))
                    elif found.how == "timeout":
                        break  # the others would not end either
                elif found.how is not None:
                    kills.append(Kill(model.cfg, found.how, found.what))
                    break
        return Outcome(mutant, tuple(kills), False, seconds)

    def _graph(self, mutant: Mutant, folder: Path) -> _Found:
        """Whether the graphs of one station are still the oracles; the small one first."""
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

    def deep(self, mutant: Mutant) -> Outcome:
        """All properties that any of the models that must hold finds violated."""
        kills: list[Kill] = []
        seconds = 0.0
        with scratch.folder("mutant") as folder:
            for model in self._seeing(mutant):
                for found in self._violated(mutant, model, folder):
                    seconds += found.seconds
                    if found.how == "invalid":
                        return Outcome(mutant, (), True, seconds)
                    if found.how is not None:
                        kills.append(Kill(model.cfg, found.how, found.what))
        return Outcome(mutant, tuple(kills), False, seconds)

    def _seeing(self, mutant: Mutant) -> Iterator[Model]:
        return (m for m in self.models if mutant.module in self._read_by[m.module])

    def _violated(self, mutant: Mutant, model: Model, folder: Path) -> Iterator[_Found]:
        """Run again without the property just violated, till nothing more is."""
        rest, left = models.split(self._cfg[model.cfg])
        while left:
            found = self._check(mutant, model, _joined(rest, left), folder)
            ids = [PROPERTY_IDS.get(name, name) for _, name in left]
            if found.how == "property" and found.what not in ids:
                # TLC does not name a temporal property: each by itself.
                for one in [x for x in left if x[0].startswith("PROPERT")]:
                    yield self._check(mutant, model, _joined(rest, [one]), folder)
                return
            yield found
            if found.how != "property":
                return
            del left[ids.index(found.what)]

    def _check(self, mutant: Mutant, model: Model, cfg: str, folder: Path) -> _Found:
        """What TLC says of a mutant; a difference counts if the model is right without it.

        If it does not end, and the model is slower here than it was when it was recorded, it gets
        more time.
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
        """One run of TLC, or what it said last time. folder is the mutant's own.

        That it did not end is not taken from the last time: the machine may have been busy.
        """
        modules = {name: self._modules[name] for name in sorted(self._read_by[model.module])}
        if mutant is not None:
            modules[mutant.module] = mutant.apply(modules[mutant.module])
        expected = model.model_dump_json(exclude={"seconds", "why", "profile"})
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
        (folder / f"{model.cfg}.cfg").write_text(cfg, encoding="utf-8")
        verdict = models.check(
            model,
            models_dir=folder,
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
    """When TLC does not end, if it ended after so long without a mutant."""
    return 3 * seconds + 10


def _answers(data: dict[str, Any]) -> str:
    """All of an oracle but the version of the specification it was made from."""
    return json.dumps({k: v for k, v in data.items() if k != "spec_hash"}, sort_keys=True)


@cache
def _committed(graph: oracle_generation.Graph) -> str:
    return _answers(json.loads(oracle.content(graph.path)))


class _Stopped(Exception):
    """The run is being ended."""


def _found(verdict: models.Verdict, cfg: str) -> _Found:
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
    models_dir: Path = MODELS,
    cache: Path | None = None,
    jobs: int = 2,
    search_s: float = 15,
    say: Say = lambda text: None,
) -> Report:
    """Hold each mutant against the models, some at a time; say gets a status line.

    On Ctrl-C the runs that go on are killed, and the report has what is known; the next run
    with the same cache goes on from there. Raises MutationError if a model is not as expected
    without a mutant or a tool fails.
    """
    if profile == "deep":
        chosen = [model for model in chosen if model.expect == "holds"]
    the_run = _Run(chosen, tla, models_dir, Cache(cache), search_s)
    work = the_run.quick if profile == "quick" else the_run.deep
    outcomes: dict[str, Outcome] = {}
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        try:
            futures = [pool.submit(work, mutant) for mutant in mutants]
            for future in as_completed(futures):
                outcome = future.result()
                outcomes[outcome.mutant.id] = outcome
                survived = sum(o.survived for o in outcomes.values())
                say(f"{len(outcomes)} of {len(mutants)} mutants, {survived} survived")
        except KeyboardInterrupt:
            the_run.stop.now()
            pool.shutdown(cancel_futures=True)
        except BaseException:
            the_run.stop.now()
            pool.shutdown(cancel_futures=True)
            raise
    return Report(profile, len(mutants), [outcomes[m.id] for m in mutants if m.id in outcomes])
