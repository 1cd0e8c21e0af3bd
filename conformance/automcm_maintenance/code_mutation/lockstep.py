"""A mutant that keeps something else: does it ever say something else?  A product of two graphs.

The reference is imported a second time, unchanged, under another name.  Wherever a step leaves the
two with different states, what differs is carried on to the next state of the graph, as long as
that is new, and all inputs are given to both there.  If what they send, tell, and arm is always the
same, with all deadlines, nobody can tell them apart on this graph.
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
    """The reference and its walker once more, from their files, under names of their own."""

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
    """The module ``behaviour`` over the unchanged reference."""
    if not any(isinstance(finder, _Again) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Again())
    return importlib.import_module(f"{RIGHT}.behaviour")


def told_apart(
    wrong: behaviour_digest.Walker, right: Any, kinds: Set[str] | None = None
) -> list[object] | None:
    """The first pair that tells them apart: the state, the mutant's changes of it, the input, and
    what each says.  None if there is none.

    ``right`` is a walker of ``unchanged``.  ``kinds``: only inputs of these can be answered
    otherwise where both are in the same state; None: all.
    """
    oracle = wrong.oracle
    left: deque[tuple[int, Changed]] = deque((n, {}) for n in range(len(oracle.states)))
    seen: set[tuple[int, str]] = set()
    while left:
        n, changed = left.popleft()
        here, other = right.at(n), wrong.at(n)
        if changed:
            other = other._replace(**changed)
        for i, value in enumerate(oracle.inputs):
            answer = oracle.answer(n, i)
            same = not changed and kinds is not None and wrong.kinds[i] not in kinds
            if answer is None or same:
                continue
            said, after = right.said(here, value)
            heard, then = wrong.said(other, value)
            if said != heard:
                return [to_json(oracle.states[n]), repr(changed), to_json(value), said, heard]
            if after is here and then is other:
                continue
            differs = _changed(after, then)
            place = (answer.next, repr(differs))
            if differs and place not in seen:
                seen.add(place)
                left.append((answer.next, differs))
    return None


def _changed(right: Any, wrong: Any) -> Changed:
    """The fields in which two states differ; they are of two classes, so by what they print."""
    found = wrong._asdict()
    return {
        name: value for name, value in found.items() if repr(value) != repr(getattr(right, name))
    }
