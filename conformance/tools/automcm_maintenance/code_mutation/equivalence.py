"""Decides whether a mutant is equivalent to the reference on the graphs.

At every state of a graph both get every input, and their outputs and states are compared
(behaviour_digest.py).  An input is only skipped if it cannot call the changed function; the tables
of the reference define which functions each kind of input can call.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

from automcm_conformance.suite.purposes import Owners
from automcm_maintenance.code_mutation.mutated_process import GRAMMAR, full_name
from automcm_maintenance.code_mutation.source_mutants import (
    MODULES,
    REFERENCE,
    SourceMutant,
    path_of,
)
from automcm_spec.graph import oracle
from automcm_spec.graph.oracle_generation import GRAPHS, spec_hash
from automcm_spec.support import children, files
from automcm_spec.vocabulary.rules import kind

WALKS = (
    ("forms", 0),
    *(("tight", n) for n in range(3)),
    *(("one-peer", n) for n in range(3)),
    ("two-peers", 0),
)
"""Graphs and variants, the fast ones first."""
WALK = "accepted_forms", "behaviour_digest", "equivalence", "lockstep", "mutated_process"
FILES = (
    *(Path(__file__).with_name(f"{name}.py") for name in WALK),
    *sorted(path_of("messages").parent.glob("*.py")),
    Path(oracle.__file__),
)
"""What a comparison depends on, besides the reference and the graphs."""
SECONDS = 7_200
"""Limit of real time for one walk."""


@dataclass(frozen=True)
class Difference:
    """A state and an input at which a mutant behaves differently, in the form of JSON."""

    graph: str
    state: object
    input: str
    right: str
    wrong: str


@dataclass(frozen=True)
class FirstDifference:
    """The first state of a graph with a difference, by number, and the kinds of input that differ
    there."""

    walk: tuple[str, int]
    state: int
    kinds: list[str]


class EquivalenceError(Exception):
    """A walk that did not finish; the text is the last line of its standard error."""


def digests(folder: Path, walk: tuple[str, int]) -> Path:
    """The digests of the reference; written, by one process, if they do not exist.

    Raises EquivalenceError, OSError.
    """
    graph, variant = walk
    path = folder / f"{graph}-{variant}-{_present()}.digests"
    files.folder(folder, named=True)
    with path.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not path.exists():
            part = path.with_suffix(".part")
            _child("state", "-", "write", graph, str(variant), str(part))
            part.rename(path)
    return path


def first_difference(
    mutant: SourceMutant, source: Path, folder: Path, walks: Iterable[tuple[str, int]]
) -> FirstDifference | None:
    """Where a mutant first behaves differently on these graphs, or None.

    ``source`` is the file of the mutated module, ``folder`` holds the digests.

    Raises EquivalenceError, OSError.
    """
    kinds = sorted(kinds_of(mutant))
    for walk in walks:
        graph, variant = walk
        if graph == "forms" and mutant.module not in GRAMMAR:
            continue
        task = ("compare", graph, str(variant), str(digests(folder, walk)), *kinds)
        found = _child(mutant.module, str(source), *task).strip()
        if found:
            return FirstDifference(walk, *json.loads(found))
    return None


def hidden(mutant: SourceMutant, source: Path, walks: Iterable[tuple[str, int]]) -> bool:
    """Whether a mutant with another state has equal outputs on these graphs (lockstep.py).

    Raises EquivalenceError.
    """
    if mutant.module == "messages":
        return False  # a change there is no matter of a state, and both sides of lockstep share it
    kinds = sorted(kinds_of(mutant))
    return all(
        json.loads(_child(mutant.module, str(source), "lockstep", graph, str(variant), "-", *kinds))
        is None
        for graph, variant in walks
        if graph in GRAPHS
    )


def hint(found: FirstDifference, owners: Owners) -> set[str]:
    """The cases with such inputs at such a state, which should find the difference."""
    if found.walk[0] not in GRAPHS:
        return set()
    graph = oracle.load(GRAPHS[found.walk[0]].path)
    cases = set()
    for answer in graph.answers(found.state):
        value = graph.inputs[answer.input]
        if kind(value) in found.kinds:
            state = graph.states[answer.state]
            owner = owners.owner(state, value, answer.effect, answer.changes)
            cases |= {owner.id} if owner is not None else set()
    return cases


def shown(mutant: SourceMutant, source: Path, found: FirstDifference) -> Difference:
    """The difference there.  Raises EquivalenceError."""
    graph, variant = found.walk
    show = ("show", graph, str(variant), str(found.state))
    right = json.loads(_child("state", "-", *show))
    wrong = dict(json.loads(_child(mutant.module, str(source), *show))["answers"])
    for given, answer in right["answers"]:
        if wrong.get(given, "") != answer:
            return Difference(graph, right["state"], given, answer, wrong.get(given, ""))
    raise EquivalenceError(
        f"{mutant.id}: {graph} {found.state}: the difference is not reproducible"
    )


@cache
def _present() -> str:
    """A hash of the reference, the graphs and the walk."""
    found = hashlib.sha256(spec_hash().encode())
    for path in [*sorted(REFERENCE.rglob("*.py")), *FILES]:
        found.update(path.read_bytes())
    return found.hexdigest()[:12]


def _child(*arguments: str) -> str:
    command = [sys.executable, "-m", "automcm_maintenance.code_mutation.mutated_process"]
    try:
        done = subprocess.run(
            children.ending_with_parent([*command, *arguments]),
            capture_output=True,
            text=True,
            timeout=SECONDS,
        )
    except subprocess.TimeoutExpired as error:
        raise EquivalenceError(f"no end after {SECONDS} s") from error
    if done.returncode:
        raise EquivalenceError(f"exit code {done.returncode}: {done.stderr.strip()[-500:]}")
    return done.stdout


# -- the functions that each kind of input can call


def kinds_of(mutant: SourceMutant) -> set[str]:
    """The kinds of input that can run the changed code; empty: any kind."""
    place = mutant.id.split("/")[1]
    always, by_kind = _reach()
    if place in always:
        return set()
    return {kind for kind, names in by_kind.items() if (mutant.module, place) in names}


@cache
def _reach() -> tuple[set[str], dict[str, set[tuple[str, str]]]]:
    """The functions that any input can call, and those of each kind of input."""
    import importlib

    from automcm.core.rules import RULES

    modules = {name: importlib.import_module(full_name(name)) for name in MODULES}
    functions = _functions(modules.values())
    station = [f for f in functions if f.__module__ == "automcm.core.station"]
    always = {name for _, name in _names(_closure(station, functions))} | {"marks"}
    by_kind = {}
    for name, rows in RULES.items():
        roots = [f for row in rows for f in (row.when, row.then) if isinstance(f, FunctionType)]
        names = _names(_closure(roots, functions))
        by_kind[name] = names | set(_tables(modules, name, rows))
    return always, by_kind


def _tables(modules: Mapping[str, ModuleType], kind: str, rows: Any) -> Iterable[tuple[str, str]]:
    """The tables with the rows of a kind."""
    mine = {id(row) for row in rows}
    for module, content in modules.items():
        for name, value in vars(content).items():
            if name == "RULES" or not name.isupper():
                continue
            if isinstance(value, tuple) and any(id(row) in mine for row in value):
                yield module, name
            if isinstance(value, dict) and kind.partition(" ")[2] in value:
                yield module, name


def _functions(modules: Iterable[ModuleType]) -> list[FunctionType]:
    found: list[FunctionType] = []
    for module in modules:
        for value in vars(module).values():
            if getattr(value, "__module__", "") != module.__name__:
                continue
            if isinstance(value, FunctionType):
                found.append(value)
            elif isinstance(value, type):
                for part in vars(value).values():
                    method = part.fget if isinstance(part, property) else part
                    if isinstance(method, FunctionType):
                        found.append(method)
    return found


def _closure(roots: Iterable[FunctionType], all_: list[FunctionType]) -> list[FunctionType]:
    """These functions and all that they can call, found by the names that they mention."""
    seen: dict[int, FunctionType] = {}
    todo = list(roots)
    while todo:
        function = todo.pop()
        if id(function) in seen:
            continue
        seen[id(function)] = function
        cells = [cell.cell_contents for cell in function.__closure__ or ()]
        todo += [value for value in cells if isinstance(value, FunctionType)]
        mentioned = _mentioned(function.__code__)
        todo += [other for other in all_ if other.__name__ in mentioned]
    return list(seen.values())


def _mentioned(code: CodeType) -> set[str]:
    names = set(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            names |= _mentioned(constant)
    return names


def _names(functions: Iterable[FunctionType]) -> set[tuple[str, str]]:
    """Module and name of each function, and of its enclosing functions."""
    return {
        (function.__module__.rpartition(".")[2], name)
        for function in functions
        for name in function.__qualname__.split(".")
    }
