"""The possible edits of one definition, from its syntax tree (``mutants``)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from automcm_maintenance.spec_mutation.mutant_rules import (
    COMMANDS,
    HISTORY,
    NEIGHBOURS,
    UNINDEXED,
    UNREAD_ZERO,
    UNSEEN_FIELDS,
)

if TYPE_CHECKING:
    from tree_sitter import Node

_BOUNDARY = {"leq": b"<", "lt": b"<=", "geq": b">", "gt": b">="}
_RELATIONS = {"eq", "neq", "leq", "lt", "geq", "gt", "in", "notin", "subseteq"}


@dataclass(frozen=True)
class Edit:
    """A replacement of bytes; node is the changed one."""

    kind: str
    start: int
    end: int
    new: bytes
    node: Node

    def order(self) -> tuple[int, int, str, bytes]:
        """The sort key of the mutants of a definition."""
        return (self.start, self.end, self.kind, self.new)


class Definition:
    """The edits of one definition.

    A list of bulleted conjuncts depends on columns.  Therefore dropped text becomes blanks, and
    longer text is followed by a new line up to the column of the remaining text.
    """

    def __init__(self, source: bytes, node: Node) -> None:
        self._source = source
        self._definition = node
        names = node.children_by_field_name("parameter")
        self._has_station = "st" in {text(name) for name in names}

    def edits(self) -> Iterator[Edit]:
        """All edits of the definition."""
        body = self._definition.child_by_field_name("definition")
        assert body is not None
        if _symbol(body) in _RELATIONS | {"lnot"}:
            yield self._replace("guard", body, b"TRUE")
        yield from self._walk(body)

    def _walk(self, node: Node) -> Iterator[Edit]:
        if visit := _VISITORS.get(node.type):
            yield from visit(self, node)
        for child in node.named_children:
            if not _left_alone(node, child):
                yield from self._walk(child)

    # Making edits

    def _replace(self, kind: str, node: Node, *parts: bytes | Node) -> Edit:
        """Replace a node by texts and nodes (a node of several lines keeps its columns)."""
        new, column = b"", node.start_point.column
        for part in parts:
            if isinstance(part, bytes):
                piece = part
            else:
                piece = self._source[part.start_byte : part.end_byte]
                if b"\n" in piece:
                    new += _up_to(column, part.start_point.column)
                    column = part.start_point.column
            new += piece
            lines = piece.split(b"\n")
            column = len(lines[-1]) + (column if len(lines) == 1 else 0)
        if self._source[node.end_byte :].split(b"\n", 1)[0].strip():
            new += _up_to(column, node.end_point.column)
        return Edit(kind, node.start_byte, node.end_byte, new, node)

    def _drop(self, kind: str, node: Node, start: int, end: int) -> Edit:
        return Edit(kind, start, end, re.sub(rb"[^\n]", b" ", self._source[start:end]), node)

    def _drop_each(self, kind: str, nodes: Sequence[Node]) -> Iterator[Edit]:
        """Drop each of several expressions with the operator (or comma) that joins it."""
        for n, node in enumerate(nodes):
            start = nodes[n - 1].end_byte if n else node.start_byte
            end = node.end_byte if n or len(nodes) == 1 else nodes[1].start_byte
            yield self._drop(kind, node, start, end)

    # Kinds of edits

    def _list(self, node: Node) -> Iterator[Edit]:
        kind = "conjunct" if node.type == "conj_list" else "disjunct"
        for item in node.named_children:
            if item.type not in ("conj_item", "disj_item"):
                continue
            if (variable := _assigned(item)) is None:
                yield self._drop(kind, item, item.start_byte, item.end_byte)
            elif variable not in HISTORY:
                value = item.named_children[-1].child_by_field_name("rhs")
                assert value is not None
                yield self._replace("assignment", value, variable.encode())

    def _infix(self, node: Node) -> Iterator[Edit]:
        symbol = _symbol(node)
        lhs, rhs = node.child_by_field_name("lhs"), node.child_by_field_name("rhs")
        sign = node.child_by_field_name("symbol")
        assert lhs is not None and rhs is not None and sign is not None
        kind = {"land": "conjunct", "lor": "disjunct", "cup": "member"}.get(symbol)
        if kind and (node.parent is None or _symbol(node.parent) != symbol):
            yield from self._drop_each(kind, _operands(node, symbol))
        elif symbol == "implies":
            yield self._drop("conjunct", lhs, lhs.start_byte, rhs.start_byte)
        elif symbol == "setminus":
            yield self._drop("member", rhs, lhs.end_byte, rhs.end_byte)
        elif symbol in _BOUNDARY:
            yield self._replace("number", sign, _BOUNDARY[symbol])

    def _negated(self, node: Node) -> Iterator[Edit]:
        if _symbol(node) == "lnot":
            sign = node.child_by_field_name("symbol")
            assert sign is not None
            yield self._drop("guard", node, sign.start_byte, sign.end_byte)

    def _negate(self, condition: Node) -> Iterator[Edit]:
        if _symbol(condition) == "lnot":
            yield from self._negated(condition)
        else:
            yield self._replace("guard", condition, b"~(", condition, b")")

    def _if(self, node: Node) -> Iterator[Edit]:
        condition = node.child_by_field_name("if")
        assert condition is not None
        yield from self._negate(condition)
        yield self._replace("branch", condition, b"FALSE")

    def _call(self, node: Node) -> Iterator[Edit]:
        if text(_name(node)) == "If":
            yield from self._negate(_arguments(node)[0])

    def _case(self, node: Node) -> Iterator[Edit]:
        """Drop an arm, only if there is an arm OTHER: else TLC could not evaluate the CASE."""
        arms = [child for child in node.named_children if child.type == "case_arm"]
        if any(child.type == "other_arm" for child in node.named_children):
            rest = [child for child in node.named_children if child.type != "comment"]
            for arm in arms:
                box = next(n for n in rest if n.type == "case_box" and n.start_byte > arm.end_byte)
                yield self._drop("disjunct", arm, arm.start_byte, box.end_byte)
        elif self._has_station:
            for arm in arms:
                yield self._replace("action", arm.named_children[-1], b'Ignore(st, "-")')

    def _update(self, node: Node) -> Iterator[Edit]:
        value = node.child_by_field_name("new_val")
        assert value is not None
        yield self._replace("assignment", value, b"@")

    def _filter(self, node: Node) -> Iterator[Edit]:
        condition = node.child_by_field_name("filter")
        assert condition is not None
        if node.parent is None or node.parent.type != "except_update":  # there @ has the same value
            yield self._replace("conjunct", condition, b"TRUE")

    def _set(self, node: Node) -> Iterator[Edit]:
        """Not of {e} if e has a name or its parent is dropped completely."""
        members = [child for child in node.named_children if child.type != "comment"]
        parent = node.parent
        if len(members) == 1 and parent is not None:
            named = parent.type == "quantifier_bound"  # \E x \in {e}
            same = _symbol(parent) in ("cup", "setminus") or text(_name(parent)) == "If"
            if named or same:
                return
        yield from self._drop_each("member", members)

    def _string(self, node: Node) -> Iterator[Edit]:
        field = "name" if text(_name(node.parent)) == "Cmd" else _compared(node)
        table = {"kind": {}, "name": COMMANDS}.get(field, NEIGHBOURS)
        if other := table.get(text(node).strip('"')):
            yield self._replace("constant", node, f'"{other}"'.encode())

    def _boolean(self, node: Node) -> Iterator[Edit]:
        other = b"FALSE" if text(node) == "TRUE" else b"TRUE"
        yield self._replace("constant", node, other)

    def _number(self, node: Node) -> Iterator[Edit]:
        parent, n = node.parent, int(text(node))
        if n == 0 and text(_name(parent)) == UNREAD_ZERO:
            return
        index = parent is not None and parent.type == "function_evaluation"
        if index and text(parent).split("[")[0].split(".")[-1] in UNINDEXED:
            return
        other = n + 1 if n == 0 or (index and n == 1) else n - 1
        yield self._replace("number", node, str(other).encode())


_VISITORS = {
    "conj_list": Definition._list,
    "disj_list": Definition._list,
    "bound_infix_op": Definition._infix,
    "bound_prefix_op": Definition._negated,
    "if_then_else": Definition._if,
    "bound_op": Definition._call,
    "case": Definition._case,
    "except_update": Definition._update,
    "set_filter": Definition._filter,
    "finite_set_literal": Definition._set,
    "string": Definition._string,
    "boolean": Definition._boolean,
    "nat_number": Definition._number,
}


def text(node: Node | None) -> str:
    """The text of a node, "" for none."""
    return "" if node is None or node.text is None else node.text.decode()


def _up_to(column: int, wanted: int) -> bytes:
    """Blanks from one column to another."""
    return b" " * (wanted - column) if column <= wanted else b"\n" + b" " * wanted


def _symbol(node: Node) -> str:
    """The operator of an infix or prefix expression, as named in the grammar."""
    sign = node.child_by_field_name("symbol")
    return "" if sign is None else sign.type


def _operands(node: Node, symbol: str) -> list[Node]:
    """a, b and c of a /\\ b /\\ c."""
    if node.type != "bound_infix_op" or _symbol(node) != symbol:
        return [node]
    lhs, rhs = node.child_by_field_name("lhs"), node.child_by_field_name("rhs")
    assert lhs is not None and rhs is not None
    return [*_operands(lhs, symbol), *_operands(rhs, symbol)]


def _name(node: Node | None) -> Node | None:
    """The name of the called or defined operator, if there is one."""
    return None if node is None else node.child_by_field_name("name")


def _arguments(node: Node) -> list[Node]:
    return [n for n in node.children_by_field_name("parameter") if n.is_named]


def _assigned(item: Node) -> str | None:
    """v of a conjunct v' = e."""
    expression = item.named_children[-1]
    if _symbol(expression) != "eq":
        return None
    lhs = text(expression.child_by_field_name("lhs"))
    return lhs[:-1] if lhs.endswith("'") else None


def _compared(node: Node) -> str:
    """The field of a record that is compared with a string ("" if there is none)."""
    parent = node.parent
    if parent is None or _symbol(parent) not in ("eq", "neq"):
        return ""
    lhs = parent.child_by_field_name("lhs")
    return text(lhs.named_children[-1]) if lhs is not None and lhs.type == "record_value" else ""


def _left_alone(node: Node, child: Node) -> bool:
    """Whether no model depends on a part of an expression."""
    if child.type == "except_update":
        specifier = child.child_by_field_name("update_specifier")
        fields = text(child).split("=")[0]
        return specifier is not None and fields.strip(" !.") in UNSEEN_FIELDS
    if node.type == "case_arm" and child == node.named_children[0]:
        arms = [] if node.parent is None else node.parent.named_children
        return all(arm.type != "other_arm" for arm in arms)
    return child.type == "conj_item" and _assigned(child) in HISTORY
