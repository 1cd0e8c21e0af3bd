"""Mutants of the reference: small faults in its core, generated from its source, with stable names.

``automcm conform certify`` runs the suite on them.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

import automcm
import automcm_spec
from automcm_maintenance.code_mutation.mutated_process import full_name
from automcm_maintenance.code_mutation.source_edits import (
    CLASSES,
    DEFINED,
    TYPES,
    UNTOUCHED,
    USED,
    Class,
    Place,
    TextEdit,
    edits,
    inner,
)
from automcm_spec.vocabulary.rules import RULES

REFERENCE, SPECIFICATION = (Path(package.__path__[0]) for package in (automcm, automcm_spec))
MODULES = (
    *("rules", "phases", "outcome", "state", "station", "parameters"),
    *("advertising", "negotiating", "prescribing", "actuating", "ending", "messages"),
)
SHARE = 260
"""The approximate number of mutants in a certificate."""
AROUND = 16
"""Number of tokens shown on either side of a change."""
_RULE = re.compile(r"\b[A-Z]{3}-\d\b")


@dataclass(frozen=True)
class SourceMutant:
    """One mutant.  ``source`` is the complete mutated module; ``line`` counts from 1."""

    id: str
    class_: Class
    file: str
    line: int
    rule: str
    """The rule that is cited nearest to the change."""
    old: str
    new: str
    source: str

    @property
    def module(self) -> str:
        """The module that it changes."""
        return self.id.split("/")[0]


@dataclass
class Generated:
    """All mutants, and the number of changes that do not compile."""

    mutants: list[SourceMutant]
    broken: int = 0


def path_of(module: str) -> Path:
    """The file of one of MODULES."""
    package, *inner = full_name(module).split(".")
    folder = REFERENCE if package == "automcm" else SPECIFICATION
    return folder.joinpath(*inner).with_suffix(".py")


def generate(modules: Sequence[str] = MODULES) -> Generated:
    """All mutants of these modules, in the order of their text.

    Raises OSError, SyntaxError; ValueError if a name of ``source_edits`` names nothing, so that a
    renamed function is not mutated by other edits unseen.
    """
    if nothing := unnamed([path_of(name).read_text(encoding="utf-8") for name in MODULES]):
        raise ValueError(f"source_edits: names nothing: {', '.join(sorted(nothing))}")
    found = Generated([])
    for name in modules:
        _mutants(name, path_of(name), found)
    return found


def unnamed(sources: Sequence[str]) -> set[str]:
    """The names of ``source_edits`` that do not occur in these sources."""
    defined: set[str] = set()
    used: set[str] = set()
    for node in (node for source in sources for node in ast.walk(ast.parse(source))):
        match node:
            case ast.FunctionDef(name) | ast.ClassDef(name):
                defined.add(name)
            case ast.Assign([ast.Name(name), *_]) | ast.AnnAssign(ast.Name(name)):
                defined.add(name)
            case ast.Name(name) | ast.Attribute(_, name) | ast.keyword(name) | ast.alias(name):
                used.add(name or "")
    return {*DEFINED - defined, *USED - used - defined}


def of_file(path: Path) -> list[SourceMutant]:
    """All mutants of any module.  Raises OSError, SyntaxError."""
    found = Generated([])
    _mutants(path.stem, path, found)
    return found.mutants


def sample(mutants: Sequence[SourceMutant], count: int, seed: int) -> list[SourceMutant]:
    """A sample of ``count`` mutants in their order (0 = all).

    It takes in turn one of each class, and within a class one of each function, those with the
    smallest hash of seed and id first.
    """
    if count == 0:
        return list(mutants)
    places: dict[tuple[str, str], list[SourceMutant]] = defaultdict(list)
    for mutant in sorted(mutants, key=lambda mutant: hash_of(f"{seed} {mutant.id}")):
        places[mutant.class_, mutant.id.rsplit("/", 1)[0]].append(mutant)
    by_class: dict[str, list[SourceMutant]] = {}
    for class_ in CLASSES:
        groups = [group for (of, _), group in places.items() if of == class_]
        by_class[class_] = list(_in_turn(groups))
    chosen = {mutant.id for mutant in list(_in_turn(list(by_class.values())))[:count]}
    return [mutant for mutant in mutants if mutant.id in chosen]


def _in_turn(groups: Sequence[Sequence[SourceMutant]]) -> Iterator[SourceMutant]:
    for k in range(max(map(len, groups), default=0)):
        for group in groups:
            if k < len(group):
                yield group[k]


def hash_of(text: str) -> str:
    """The sort key of a sample by seed."""
    return hashlib.sha256(text.encode()).hexdigest()


def _mutants(module: str, path: Path, found: Generated) -> None:
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    same: set[tuple[int, str]] = {(node.lineno, ast.dump(node)) for node in tree.body}
    starts = _starts(source)
    numbers: dict[tuple[str, str], int] = defaultdict(int)
    for place, edit, statement in _all(tree, module == "messages"):
        start, end = _span(source, starts, edit.node)
        mutated = source[:start] + edit.new + source[end:]
        first, last = _span(source, starts, statement)
        try:
            changed = ast.parse(mutated[first : last + len(mutated) - len(source)])
            compile(changed, path.name, "exec")
        except SyntaxError:
            found.broken += 1
            continue
        dumped = statement.lineno, ast.dump(changed.body[0]) if changed.body else ""
        if dumped in same:
            continue
        same.add(dumped)
        numbers[place, edit.class_] += 1
        line: int = edit.node.lineno  # type: ignore[attr-defined]
        found.mutants.append(
            SourceMutant(
                f"{module}/{place}/{edit.class_}-{numbers[place, edit.class_]}",
                edit.class_,
                "/".join(path.parts[-3:]),
                line,
                _rule(source, statement, line),
                *_shown(source[start:end], edit),
                mutated,
            )
        )


def _all(tree: ast.Module, form: bool) -> Iterator[tuple[str, TextEdit, ast.stmt]]:
    """The name of the function or table, the edit, and its top-level statement."""
    for statement in tree.body:
        targets: list[ast.expr] = []
        if isinstance(statement, ast.AnnAssign):
            targets = [statement.target]
        elif isinstance(statement, ast.Assign):
            targets = statement.targets
        names = {ast.unparse(target) for target in targets}
        names |= {statement.name} if isinstance(statement, ast.ClassDef) else set()
        if names & {*TYPES}:
            continue
        stack: list[tuple[ast.AST, Place]] = [(statement, Place("", form))]
        while stack:
            node, place = stack.pop()
            if isinstance(node, ast.FunctionDef) and node.name in UNTOUCHED:
                continue
            for edit in edits(node, place):
                if hasattr(edit.node, "lineno"):
                    yield place.name or getattr(node, "name", "module"), edit, statement
            stack += reversed(list(inner(node, place)))


def _starts(source: str) -> list[int]:
    """The offset of each line."""
    return [0, *accumulate(len(line) for line in source.splitlines(keepends=True))]


def _span(source: str, starts: Sequence[int], node: ast.AST) -> tuple[int, int]:
    """The offsets in characters at which a node begins and ends."""

    def at(line: int, column: int) -> int:
        text = source[starts[line - 1] : starts[line]]
        return starts[line - 1] + len(text.encode()[:column].decode())

    first = at(node.lineno, node.col_offset)  # type: ignore[attr-defined]
    return first, at(node.end_lineno, node.end_col_offset)  # type: ignore[attr-defined]


def _rule(source: str, statement: ast.stmt, line: int) -> str:
    """The rule cited nearest to a line, in its own statement if there is one."""
    lines: list[str] = source.split("\n")
    first, last = statement.lineno, statement.end_lineno or statement.lineno
    name = getattr(statement, "name", "")
    named = [n for n, text in enumerate(lines, 1) if name and f" {name}" in text and "Row(" in text]
    for numbers in (range(first, last + 1), named, range(1, len(lines) + 1)):
        near = [
            (abs(n - line), cited)
            for n in numbers
            for cited in _RULE.findall(lines[n - 1])
            if cited in RULES
        ]
        if near:
            rule: str = min(near)[1]
            return rule
    return ""


def _shown(old: str, edit: TextEdit) -> tuple[str, str]:
    """The old and the new text on one line each; of a long text only the changed part."""
    old = old if isinstance(edit.node, ast.Pass) else ast.unparse(edit.node)
    one, other = " ".join(old.split()), " ".join(edit.new.split())
    words, others = re.split(r"(?<=\W)|(?=\W)", one), re.split(r"(?<=\W)|(?=\W)", other)
    least = min(len(words), len(others))
    head = next((k for k in range(least) if words[k] != others[k]), least)
    ends = range(1, least - head + 1)
    tail = next((k - 1 for k in ends if words[-k] != others[-k]), least - head)
    return _cut(words, head, tail), _cut(others, head, tail)


def _cut(words: Sequence[str], head: int, tail: int) -> str:
    """The words between head and tail, with some context on both sides."""
    first, last = max(0, head - AROUND), len(words) - max(0, tail - AROUND)
    text = "".join(words[first:last]).strip()
    return f"{'… ' if first else ''}{text}{' …' if last < len(words) else ''}"
