"""Mutants of the TLA+ modules: small faults from the syntax tree that the models should find.

Needs the packages of the extra ``mutate`` (tree-sitter and its TLA+ grammar).
"""

from __future__ import annotations

import hashlib
import re
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from automcm_maintenance.spec_mutation.mutant_edits import Definition, Edit, text
from automcm_maintenance.spec_mutation.mutant_rules import MODULES, NOT_MUTATED, PROPERTIES_FROM
from automcm_spec.support.paths import TLA

if TYPE_CHECKING:
    from tree_sitter import Node, Parser

_SHOWN = 60  # characters of context shown around a change


class MissingPackage(Exception):
    """The packages of the extra ``mutate`` are not installed."""


@dataclass(frozen=True)
class Mutant:
    """One change of a module.

    id is stable while the definition and the text around the change are.  line counts from 1; start
    and end are the replaced bytes; before and after show the change with some context.
    """

    id: str
    module: str
    operator: str
    kind: str
    line: int
    start: int
    end: int
    replacement: bytes
    before: str
    after: str

    @property
    def change(self) -> str:
        """The old and the new text, on one line."""
        return f"{self.before}  =>  {self.after or '(nothing)'}"

    def apply(self, source: bytes) -> bytes:
        """The text of the mutated module."""
        return source[: self.start] + self.replacement + source[self.end :]


def generate(tla: Path = TLA, modules: Sequence[str] = MODULES) -> list[Mutant]:
    """All mutants of the modules, in the order of their text.

    Raises MissingPackage without the extra, OSError for a module that cannot be read, and
    ValueError for one that the grammar does not understand.
    """
    parser = _parser()
    return [mutant for name in modules for mutant in _mutants(parser, tla, name)]


def sample(mutants: Sequence[Mutant], limit: int | None) -> list[Mutant]:
    """The mutants in the order of the hash of their ids, of which each beginning is a fair sample.

    It remains mostly the same after an edit of the specification.
    """
    return sorted(mutants, key=lambda m: _hash(m.id))[:limit]


def _squeezed(source: bytes) -> bytes:
    """The text without insignificant blanks, to compare mutants."""
    return b"".join(source.split())


def _hash(value: str) -> str:
    return hashlib.sha256(value.encode()).hexdigest()


def _parser() -> Parser:
    try:
        import tree_sitter
        import tree_sitter_tlaplus
    except ImportError as error:
        raise MissingPackage(
            f"the package {error.name} is not installed; the extra 'mutate' has it: "
            "pip install 'automcm[mutate]'"
        ) from error
    with warnings.catch_warnings():  # the grammar still passes its pointer as a number
        warnings.simplefilter("ignore", DeprecationWarning)
        return tree_sitter.Parser(tree_sitter.Language(tree_sitter_tlaplus.language()))


def _mutants(parser: Parser, tla: Path, module: str) -> list[Mutant]:
    source = (tla / f"{module}.tla").read_bytes()
    tree = parser.parse(source)
    if tree.root_node.has_error:
        raise ValueError(f"{module}.tla: the grammar tree-sitter-tlaplus cannot parse it")
    end = source.find(PROPERTIES_FROM.encode())
    found: list[Mutant] = []
    texts = {_squeezed(source)}
    for node in tree.root_node.children[0].children:
        if node.type != "operator_definition" or 0 <= end < node.start_byte:
            continue
        name = text(node.child_by_field_name("name"))
        if f"{module}.{name}" in NOT_MUTATED:
            continue
        alike: Counter[tuple[str, str, str]] = Counter()
        for edit in sorted(Definition(source, node).edits(), key=Edit.order):
            mutated = _squeezed(source[: edit.start] + edit.new + source[edit.end :])
            if mutated in texts:
                continue
            texts.add(mutated)
            before, after = _around(source, edit)
            alike[edit.kind, before, after] += 1
            digest = _hash("\0".join((before, after, str(alike[edit.kind, before, after]))))
            place = edit.node.start_point.row + 1
            id_ = f"{module}.{name}.{edit.kind}.{digest[:6]}"
            span = (edit.start, edit.end, edit.new)
            found.append(Mutant(id_, module, name, edit.kind, place, *span, before, after))
    return found


def _around(source: bytes, edit: Edit) -> tuple[str, str]:
    """The texts before and after: the change within the largest short expression."""
    start, end = min(edit.start, edit.node.start_byte), max(edit.end, edit.node.end_byte)
    node: Node | None = edit.node
    if edit.node.parent is not None and edit.node.parent.type == "record_literal":
        fields = edit.node.parent.named_children
        start = fields[fields.index(edit.node) - 2].start_byte
    while node is not None and node.type != "operator_definition":
        whole = source[node.start_byte : node.end_byte]
        if len(whole) > _SHOWN or b"\n" in whole:
            break
        start, end = min(start, node.start_byte), max(end, node.end_byte)
        node = node.parent
    after = source[start : edit.start] + edit.new + source[edit.end : end]
    return _flat(source[start:end]), _flat(after)


def _flat(source: bytes) -> str:
    """The text on one line, without comments and without the blanks of dropped text."""
    words = " ".join(re.sub(r"\\\*[^\n]*", "", source.decode()).split())
    return re.sub(r"(?<=[(\[{]) | (?=[])},])", "", words)
