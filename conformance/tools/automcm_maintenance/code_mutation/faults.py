"""The catalogues of faults: each fault is an edit of a text, and must be noticed by a check.

A catalogue is a file of TOML.  ``in`` is a module (``automcm.core.state``), a function in one
(``automcm.security.verifier:Verifier.receive``) or a file from the root of the repository; it may
stand once, before all faults.  ``old`` must occur there exactly once::

    [[fault]]
    name = "busy not refused"
    in = "automcm.core.negotiating"
    old = 'foreign(me, st, i) and st.bound'
    new = 'False'
    notice = {rule = "NEG-4"}       # what the checks of this catalogue must find

A fault with several edits has tables ``[[fault.edit]]`` with ``in``, ``old`` and ``new``.

``python -m automcm_maintenance.code_mutation.faults CATALOGUE NAME MODULE [ARGUMENT]...`` runs a
module as a program that has the fault.
"""

from __future__ import annotations

import ast
import gc
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import runpy
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, lru_cache
from inspect import CO_OPTIMIZED
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

ROOT = Path(__file__).resolve().parents[4]
FOLDERS = ("spec", "reference", "traces", "conformance", "conformance/tools")
CATALOGUES = ROOT / "conformance" / "fault_catalogue"


class FaultError(Exception):
    """A fault that cannot be made: the text says which, and why."""


@dataclass(frozen=True)
class Edit:
    """One text replaced by another."""

    place: str
    old: str
    new: str

    @property
    def path(self) -> Path:
        """The file that is edited.  Raises FaultError."""
        module = self.place.partition(":")[0]
        if "/" in module:
            return ROOT / module
        paths = [ROOT / folder / f"{module.replace('.', '/')}.py" for folder in FOLDERS]
        found = next((path for path in paths if path.exists()), None)
        if found is None:
            raise FaultError(f"there is no module {module}")
        return found

    def apply(self, text: str) -> str:
        """The text with the edit.  Raises FaultError if ``old`` does not occur exactly once."""
        first, last = _span(text, self.place.partition(":")[2])
        found = text.count(self.old, first, last)
        if found != 1 or self.old == self.new:
            raise FaultError(f"{self.place} has {found} times {self.old!r}, not once")
        return text[:first] + text[first:last].replace(self.old, self.new) + text[last:]


def _span(text: str, function: str) -> tuple[int, int]:
    """Where a function begins and ends; the whole text for none.  Raises FaultError."""
    if not function:
        return 0, len(text)
    nodes = _parsed(text)
    for name in function.split("."):
        named = [node for node in nodes if getattr(node, "name", "") == name]
        if len(named) != 1:
            raise FaultError(f"there is no {function}")
        node, nodes = named[0], getattr(named[0], "body", [])
    lines = text.splitlines(keepends=True)
    return len("".join(lines[: node.lineno - 1])), len("".join(lines[: node.end_lineno]))


@lru_cache(maxsize=64)
def _parsed(text: str) -> list[ast.stmt]:
    """A module, once for the many faults that a catalogue makes in it."""
    return ast.parse(text).body


@dataclass(frozen=True)
class Fault:
    """Edits, and what must be noticed: by the meaning of its catalogue."""

    name: str
    edits: tuple[Edit, ...]
    notice: dict[str, Any] = field(default_factory=dict)
    story: str = ""

    def texts(self, *, under: Path = ROOT) -> dict[Path, str]:
        """The edited files, with ``under`` in place of the root.  Raises FaultError."""
        texts: dict[Path, str] = {}
        for edit in self.edits:
            path = under / edit.path.relative_to(ROOT)
            try:
                texts[path] = edit.apply(texts.get(path) or path.read_text(encoding="utf-8"))
            except FaultError as error:
                raise FaultError(f"{self.name}: {error}") from None
        return texts

    def write(self, under: Path) -> None:
        """Make the edits in a copy of the repository.  Raises FaultError."""
        for path, text in self.texts(under=under).items():
            path.write_text(text, encoding="utf-8")

    def command(self, catalogue: str, module: str, *arguments: object) -> list[str]:
        """The command of a program with this fault."""
        given = [catalogue, self.name, module, *map(str, arguments)]
        return [sys.executable, "-m", __name__, *given]


def load(name: str) -> dict[str, Fault]:
    """The faults of a catalogue (a name, or a file), its edits tried.  Raises FaultError."""
    found = _read(name)
    for fault in found.values():
        fault.texts()
    return found


def _read(name: str) -> dict[str, Fault]:
    path = CATALOGUES / f"{name}.toml" if "/" not in name else ROOT / name
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    found: dict[str, Fault] = {}
    for row in data["fault"]:
        usual = row.get("in", data.get("in", ""))
        edits = [Edit(e.get("in", usual), e["old"], e["new"]) for e in row.get("edit", [row])]
        if row["name"] in found:
            raise FaultError(f"{path.name}: two faults have the name {row['name']}")
        notice, story = row.get("notice", {}), row.get("story", "")
        found[row["name"]] = Fault(row["name"], tuple(edits), notice, story)
    return found


# -- in a process of its own


class Hook(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Imports some modules from other texts, by their names."""

    def __init__(self, sources: Mapping[str, str]) -> None:
        self.sources = sources

    @classmethod
    def put(cls, sources: Mapping[str, str]) -> None:
        """Put it first.  Raises RuntimeError if such a module has been imported already."""
        if early := sources.keys() & sys.modules.keys():
            raise RuntimeError(f"imported before it was replaced: {', '.join(sorted(early))}")
        sys.meta_path.insert(0, cls(sources))

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Find a replaced module, which is no package."""
        if name not in self.sources:
            return None
        return importlib.util.spec_from_loader(name, self, is_package=False)

    def get_source(self, name: str) -> str:
        """The text that replaces the module."""
        return self.sources[name]


def main() -> None:
    """Run a module as a program that has a fault."""
    catalogue, name, module, *_ = sys.argv[1:]
    fault = _read(catalogue)[name]
    modules = {edit.path: edit.place.partition(":")[0] for edit in fault.edits}
    Hook.put({modules[path]: text for path, text in fault.texts().items()})
    del sys.argv[1:4]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


# -- in this process


@contextmanager
def put(fault: Fault) -> Iterator[None]:
    """Give the functions of this process the fault, wherever they are bound; at the end, take it
    back.  The edits are made in the files that were imported, also of a copy of the repository.

    Raises FaultError for an edit outside of all functions.
    """
    changed: list[tuple[FunctionType, CodeType, CodeType]] = []
    texts: dict[Path, str] = {}
    for edit in fault.edits:
        module = importlib.import_module(edit.place.partition(":")[0])
        parts = edit.path.relative_to(ROOT).parts
        texts |= fault.texts(under=Path(str(module.__file__)).parents[len(parts) - 1])
    for path, text in texts.items():
        right = compile(path.read_text(encoding="utf-8"), str(path), "exec", dont_inherit=True)
        wrong = compile(text, str(path), "exec", dont_inherit=True)
        try:
            pairs = dict(_functions(right, wrong))
        except ValueError:
            raise FaultError(f"{fault.name}: changes more than functions in {path.name}") from None
        living = _living(path, len(sys.modules))
        changed += [(f, f.__code__, pairs[f.__code__]) for f in living if f.__code__ in pairs]
    if not changed:
        raise FaultError(f"{fault.name}: no function of this process is changed")
    try:
        for function, _, code in changed:
            function.__code__ = code
        yield
    finally:
        for function, code, _ in changed:
            function.__code__ = code


def _functions(right: CodeType, wrong: CodeType) -> Iterator[tuple[CodeType, CodeType]]:
    """The functions that differ, also those within others.  Raises ValueError for another
    difference."""
    inner, other = (
        [each for each in code.co_consts if isinstance(each, CodeType)] for code in (right, wrong)
    )
    if right.co_flags & CO_OPTIMIZED:
        if right != wrong:
            yield right, wrong
        if len(inner) != len(other):
            return
    elif len(inner) != len(other) or _own(right) != _own(wrong):
        raise ValueError
    for pair in zip(inner, other, strict=True):
        yield from _functions(*pair)


def _own(code: CodeType) -> tuple[object, ...]:
    """What a module or class does, without its functions and the line numbers of classes."""
    numbered = code.co_name != "<module>"
    values = [c for c in code.co_consts if not isinstance(c, CodeType)]
    return code.co_code, code.co_names, [v for v in values if not (numbered and type(v) is int)]


@cache
def _living(path: Path, modules: int) -> list[FunctionType]:
    """All functions of a file that this process has, as long as it imports no more ``modules``."""
    # type(), because isinstance() asks a weak proxy whose object may be gone
    every = (each for each in gc.get_objects() if type(each) is FunctionType)
    return [each for each in every if each.__code__.co_filename == str(path)]


if __name__ == "__main__":
    main()
