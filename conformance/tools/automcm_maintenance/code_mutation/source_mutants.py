"""Mutants of the reference: small faults in its core, generated from its source, with stable names.

``automcm conform certify`` runs the suite on them.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, takewhile, zip_longest
from pathlib import Path

import automcm
import automcm_spec
from automcm_maintenance.code_mutation.mutated_process import full_name
from automcm_maintenance.code_mutation.source_edits import (
    CLASSES,
    DEFINED,
    TYPES,
    USED,
    Class,
    Place,
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
    found = [mutant for name in modules for mutant in _mutants(name, path_of(name))]
    return Generated([m for m in found if m is not None], found.count(None))


def unnamed(sources: Sequence[str]) -> set[str]:
    """The names of ``source_edits`` that do not occur in these sources."""
    defined: set[str] = set()
    used: set[str] = set()
    for node in (node for source in sources for node in ast.walk(ast.parse(source))):
        defined.add(_name(node))
        match node:
            case ast.Name(name) | ast.Attribute(_, name) | ast.keyword(name) | ast.alias(name):
                used.add(name or "")
    return {*DEFINED - defined, *USED - used - defined}


def _name(node: ast.AST) -> str:
    """The name that a statement defines; empty for other nodes."""
    match node:
        case ast.FunctionDef(name) | ast.ClassDef(name):
            return str(name)
        case ast.Assign([ast.Name(name), *_]) | ast.AnnAssign(ast.Name(name)):
            return str(name)
    return ""


def of_file(path: Path) -> list[SourceMutant]:
    """All mutants of any module.  Raises OSError, SyntaxError."""
    return [mutant for mutant in _mutants(path.stem, path) if mutant is not None]


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
    by_class = [
        _in_turn([group for (of, _), group in places.items() if of == class_]) for class_ in CLASSES
    ]
    chosen = {mutant.id for mutant in _in_turn(by_class)[:count]}
    return [mutant for mutant in mutants if mutant.id in chosen]


def _in_turn(groups: Sequence[Sequence[SourceMutant]]) -> list[SourceMutant]:
    return [mutant for turn in zip_longest(*groups) for mutant in turn if mutant is not None]


def hash_of(text: str) -> str:
    """The sort key of a sample by seed."""
    return hashlib.sha256(text.encode()).hexdigest()


def _mutants(module: str, path: Path) -> Iterator[SourceMutant | None]:
    """The mutants of a module, and None for each change that does not compile."""
    source = path.read_bytes()
    tree = ast.parse(source)
    same: set[tuple[int, str]] = {(node.lineno, ast.dump(node)) for node in tree.body}
    starts = [0, *accumulate(map(len, source.splitlines(keepends=True)))]
    numbers: Counter[tuple[str, str]] = Counter()
    for statement in (node for node in tree.body if _name(node) not in TYPES):
        first, last = _span(starts, statement)
        for node, place, class_, new in _changes(statement, Place("", module == "messages")):
            start, end = _span(starts, node)
            mutated = source[:start] + new.encode() + source[end:]
            try:
                changed = ast.parse(mutated[first : last + len(mutated) - len(source)])
                compile(changed, path.name, "exec")
            except SyntaxError:
                yield None
                continue
            dumped = statement.lineno, ast.dump(changed.body[0]) if changed.body else ""
            if dumped in same:
                continue
            same.add(dumped)
            numbers[place, class_] += 1
            old = "pass" if isinstance(node, ast.Pass) else ast.unparse(node)
            yield SourceMutant(
                f"{module}/{place}/{class_}-{numbers[place, class_]}",
                class_,
                "/".join(path.parts[-3:]),
                node.lineno,
                _rule(source.decode(), statement, node.lineno),
                *_shown(old, new),
                mutated.decode(),
            )


def _changes(node: ast.AST, place: Place) -> Iterator[tuple[ast.expr | ast.stmt, str, Class, str]]:
    """A node and its new text, with the name of the function or table and the class."""
    for class_, new in edits(node, place):
        assert isinstance(node, ast.expr | ast.stmt), "no edit is of another node"
        yield node, place.name or getattr(node, "name", "module"), class_, new
    for child, within in inner(node, place):
        yield from _changes(child, within)


def _span(starts: Sequence[int], node: ast.expr | ast.stmt) -> tuple[int, int]:
    """The offsets in bytes at which a node begins and ends, from those of the lines."""
    assert node.end_lineno is not None and node.end_col_offset is not None
    first = starts[node.lineno - 1] + node.col_offset
    return first, starts[node.end_lineno - 1] + node.end_col_offset


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
            return str(min(near)[1])
    return ""


def _shown(old: str, new: str) -> tuple[str, str]:
    """The old and the new text on one line each; of a long text only the changed part."""
    one, other = (re.split(r"(?<=\W)|(?=\W)", " ".join(text.split())) for text in (old, new))
    head = _alike(one, other)
    tail = _alike(one[head:][::-1], other[head:][::-1])
    return _cut(one, head, tail), _cut(other, head, tail)


def _alike(words: Sequence[str], others: Sequence[str]) -> int:
    """How many words at the beginning are the same."""
    pairs = zip(words, others, strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))


def _cut(words: Sequence[str], head: int, tail: int) -> str:
    """The words between head and tail, with some context on both sides."""
    first, last = max(0, head - AROUND), len(words) - max(0, tail - AROUND)
    text = "".join(words[first:last]).strip()
    return f"{'… ' if first else ''}{text}{' …' if last < len(words) else ''}"
