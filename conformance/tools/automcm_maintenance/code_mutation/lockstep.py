"""Compares the outputs of a mutant with another state to the reference, on a product of two graphs.

The unchanged reference is imported a second time under another name.  Where a step gives the two
different states, the difference is carried to the next state of the graph if it is new there, and
both get all inputs, also those that no graph has.  If their messages, indications, timers and
deadlines are always equal, the mutant is equivalent on this graph.
"""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import re
import sys
from collections import deque
from collections.abc import Sequence, Set
from pathlib import Path
from types import ModuleType
from typing import Any

import automcm
from automcm_maintenance.code_mutation import behaviour_digest
from automcm_spec.vocabulary import parameters
from automcm_spec.vocabulary.json_forms import to_json

RIGHT = "automcm_unchanged"
Changed = dict[str, Any]
"""Fields of a state, with the mutant's values where these differ."""


class _Again(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Imports the unchanged reference and its walker from their files under other names."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if name.partition(".")[0] != RIGHT:
            return None
        return importlib.util.spec_from_loader(name, self, is_package=self.is_package(name))

    def get_source(self, name: str) -> str:
        text = self._file(name).read_text(encoding="utf-8")
        grammar = f"from {parameters.__name__} import"
        text = text.replace(grammar, "from automcm.parameters import")
        return re.sub(r"\b(from|import) automcm(?=[. ])", rf"\1 {RIGHT}", text)

    def is_package(self, name: str) -> bool:
        return self._file(name).name == "__init__.py"

    def _file(self, name: str) -> Path:
        rest = name.split(".")[1:]
        if rest == ["behaviour"]:
            return Path(behaviour_digest.__file__)
        if rest == ["parameters"]:
            return Path(parameters.__file__)
        path = Path(automcm.__file__).parent.joinpath(*rest)
        return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")


def unchanged() -> Any:
    """The module ``behaviour_digest`` on the unchanged reference."""
    if not any(isinstance(finder, _Again) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Again())
    return importlib.import_module(f"{RIGHT}.behaviour")


def distinguished(
    wrong: behaviour_digest.AnyState, right: Any, kinds: Set[str] | None = None
) -> list[object] | None:
    """The first difference of outputs: the state, the mutant's changes of it, the input, and both
    outcomes.  None without a difference.

    ``right`` is a walker of ``unchanged``.  With ``kinds``, only inputs of these kinds can differ
    where both have the same state.
    """
    oracle = wrong.oracle
    left: deque[tuple[int, Changed]] = deque((n, {}) for n in range(len(oracle.states)))
    seen: set[tuple[int, str]] = set()
    while left:
        n, changed = left.popleft()
        here, other = right.at(n), wrong.at(n)
        if changed:
            other = other._replace(**changed)
        extra = right.extra_outcomes(here), wrong.extra_outcomes(other)
        if extra[0] != extra[1]:
            return [to_json(oracle.states[n]), repr(changed), "an extra input", *map(str, extra)]
        for i, value in enumerate(oracle.inputs):
            answer = oracle.answer(n, i)
            same = not changed and kinds is not None and wrong.kinds[i] not in kinds
            if answer is None or same:
                continue
            right_outcome, after = right.outcome(here, value)
            wrong_outcome, then = wrong.outcome(other, value)
            if right_outcome != wrong_outcome:
                outcomes = right_outcome, wrong_outcome
                return [to_json(oracle.states[n]), repr(changed), to_json(value), *outcomes]
            if after is here and then is other:
                continue
            differs = _changed(after, then)
            place = (answer.next, repr(differs))
            if differs and place not in seen:
                seen.add(place)
                left.append((answer.next, differs))
    return None


def _changed(right: Any, wrong: Any) -> Changed:
    """The fields in which two states differ, compared by repr because their classes differ."""
    found = wrong._asdict()
    return {
        name: value for name, value in found.items() if repr(value) != repr(getattr(right, name))
    }
