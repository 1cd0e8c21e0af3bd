"""The edits that make mutants of Python source, from its syntax tree."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Literal, TypeVar, get_args

from automcm_spec.vocabulary.application import Indication
from automcm_spec.vocabulary.messages import ANSWER_REASONS, CancelReason, Message, RefusalReason

T = TypeVar("T")
Class = Literal["table", "guard", "timer", "field", "memory", "form"]
CLASSES: tuple[Class, ...] = get_args(Class)

_NAMES = tomllib.loads(Path(__file__).with_name("source_names.toml").read_text(encoding="utf-8"))
"""Names of functions, fields and keywords, by what they mean for the edits."""
TIMER_PLACES, UNTOUCHED, TYPES = (_NAMES[kind] for kind in ("timer_places", "untouched", "types"))
COSTS, _STATES, _NUMBERS = (_NAMES[kind] for kind in ("costs", "states", "numbers"))
_TWINS: list[list[str]] = _NAMES["twins"]
_COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
_EFFECT_CALLS = {
    *(model.__name__ for model in (*get_args(Message), *get_args(Indication))),
    *_NAMES["effect_calls"],
}
_SWAPPED: tuple[tuple[str, ...], ...] = (
    tuple(reason for reason in get_args(CancelReason) if reason not in ANSWER_REASONS),
    tuple(reason for reason in get_args(RefusalReason) if reason not in ANSWER_REASONS),
    tuple(reason for reason in get_args(RefusalReason) if reason in ANSWER_REASONS),
)
"""Words of the same type that can be exchanged."""
DEFINED = frozenset((*TIMER_PLACES, *UNTOUCHED, *TYPES))
USED = frozenset((*COSTS, *_STATES, *_EFFECT_CALLS, *_NUMBERS, *chain(*_TWINS)))
"""The names above: of definitions in the mutated modules, and of what these use."""


@dataclass(frozen=True)
class Place:
    """The place of a node: its function or table, and the enclosing calls, the innermost first."""

    name: str
    form: bool
    calls: tuple[str, ...] = ()
    keyword: str = ""
    returns_bool: bool = False
    """Whether it is in a function that returns bool."""

    def class_of(self, usual: Class) -> Class:
        """The class of a mutant at this place; elsewhere it has the ``usual`` one."""
        if self.form:
            return "form"
        return "timer" if self.name in TIMER_PLACES else usual


def called(node: ast.AST) -> str:
    """The last name of a call's function; empty for other nodes."""
    if not isinstance(node, ast.Call):
        return ""
    of = node.func
    return of.id if isinstance(of, ast.Name) else of.attr if isinstance(of, ast.Attribute) else ""


def _text(node: ast.AST) -> str:
    text = ast.unparse(node)
    simple = (ast.Name, ast.Attribute, ast.Constant, ast.Call, ast.Subscript, ast.Tuple, ast.Dict)
    return text if isinstance(node, (*simple, ast.List, ast.Set, ast.stmt)) else f"({text})"


def _without_item(items: Sequence[T], k: int) -> list[T]:
    return [*items[:k], *items[k + 1 :]]


def edits(node: ast.AST, place: Place) -> Iterator[tuple[Class, str]]:
    """The texts that replace the text of this node, with their classes."""
    for class_, new in _faults(node, place):
        yield place.class_of(class_), new if isinstance(new, str) else _text(new)


def _faults(node: ast.AST, place: Place) -> Iterator[tuple[Class, ast.AST | str]]:
    match node:
        case ast.BoolOp():
            yield from _logic(node)
        case ast.Compare(left, [op], [right]):
            for other in _COMPARED[type(op)]:
                yield "guard", ast.Compare(left, [other()], [right])
        case ast.UnaryOp(ast.Not(), operand):
            yield "guard", operand
        case ast.IfExp(test, body, orelse):
            yield "guard", ast.IfExp(test, orelse, body)
        case ast.BinOp():
            yield from _arithmetic(node, place)
        case ast.Call():
            yield from _call(node, place)
        case ast.Dict():
            yield from _entries(node, place)
        case ast.Tuple(elts=items) | ast.List(elts=items):
            yield from _items(items)
        case ast.Attribute(value, name):
            for twin in _following(name, _TWINS):
                class_: Class = "timer" if name.startswith(("t_", "backoff_m")) else "field"
                yield class_, ast.Attribute(value, twin)
        case ast.Constant(bool(value)) if place.keyword:
            yield "memory" if place.calls[0] in _STATES else "field", repr(not value)
        case ast.Subscript(value, ast.Constant(str(name))) if place.name in TIMER_PLACES:
            for twin in _following(name, _TWINS):
                yield "timer", ast.Subscript(value, ast.Constant(twin))
        case ast.Constant(int(rank)) if place.calls[:1] == ("TimerRow",):
            yield "timer", repr(rank + 1.5)  # behind the next
        case ast.Constant(int(number)) if type(number) is int and place.name:
            yield "field", repr(number + 1)
        case ast.Constant(str(word)):
            yield from _word(word, place)
        case ast.stmt():
            yield from _statement(node, place)


def _logic(node: ast.BoolOp) -> Iterator[tuple[Class, ast.AST | str]]:
    for k in range(len(node.values)):
        kept = _without_item(node.values, k)
        yield "guard", kept[0] if len(kept) == 1 else ast.BoolOp(node.op, kept)
    other = ast.Or() if isinstance(node.op, ast.And) else ast.And()
    yield "guard", ast.BoolOp(other, node.values)


def _arithmetic(node: ast.BinOp, place: Place) -> Iterator[tuple[Class, ast.AST | str]]:
    class_: Class = "table" if place.name.isupper() else "field"
    if isinstance(node.op, ast.BitOr):
        yield "memory", node.left
        yield "memory", node.right
        return
    if class_ == "table" and place.name not in TIMER_PLACES:
        yield class_, node.right
        return
    yield class_, node.left
    other = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Add}.get(type(node.op))
    if other is not None:
        yield class_, ast.BinOp(node.left, other(), node.right)
    if place.name in TIMER_PLACES:
        for ms in (1, -1):
            yield class_, ast.BinOp(node, ast.Add(), ast.Constant(ms))
        yield class_, ast.BinOp(ast.Constant(2), ast.Mult(), node)


def _call(node: ast.Call, place: Place) -> Iterator[tuple[Class, ast.AST | str]]:
    name, empty = called(node), ast.Tuple([], ast.Load())
    if name == "Row" and len(node.args) == 3:
        rule, when, then = map(ast.unparse, node.args)
        if when != "always":
            yield "table", f"Row({rule}, lambda me, st, i: True, {then})"
        if then != "ignore":
            yield "table", f"Row({rule}, {when}, lambda me, st, i: Outcome(st))"
        return
    if name == "Outcome" and node.args and called(node.args[0]):
        yield "memory", ast.Call(node.func, [ast.Name("st"), *node.args[1:]], node.keywords)
    if name in ("Outcome", "leave_with") and len(node.args) > 1:
        yield "field", ast.Call(node.func, [node.args[0], empty, *node.args[2:]], node.keywords)
    if name == "Outcome" and len(node.args) > 2:
        yield "field", ast.Call(node.func, node.args[:2], node.keywords)
    for k, keyword in enumerate(node.keywords):
        if keyword.arg is None or keyword.arg in COSTS:
            continue
        dropped = ast.Call(node.func, node.args, _without_item(node.keywords, k))
        if name in _STATES:
            yield "memory", dropped
        elif name == "Outcome":
            yield ("timer" if keyword.arg == "again" else "field"), dropped
        elif name in _EFFECT_CALLS or place.form:
            yield "field", dropped
        if keyword.arg in _NUMBERS and not isinstance(keyword.value, ast.Constant):
            more = ast.keyword(keyword.arg, ast.BinOp(keyword.value, ast.Add(), ast.Constant(1)))
            changed = [*node.keywords[:k], more, *node.keywords[k + 1 :]]
            class_: Class = "memory" if name in _STATES else "field"
            yield class_, ast.Call(node.func, node.args, changed)
    if name == "without":
        for k in range(1, len(node.args)):
            yield "memory", ast.Call(node.func, _without_item(node.args, k), [])
    if name in ("leave", "post") and node.args:
        yield "memory", node.args[0]
    if other := {"min": "max", "max": "min"}.get(name):
        yield "field", ast.Call(ast.Name(other), node.args, node.keywords)
    if name in ("to", "from_") and len(node.args) > 1:
        for k in range(len(node.args)):
            yield "table", ast.Call(node.func, _without_item(node.args, k), node.keywords)


def _entries(node: ast.Dict, place: Place) -> Iterator[tuple[Class, ast.AST | str]]:
    if place.name.isupper() or any(key is None for key in node.keys):
        for k in range(len(node.keys)):
            keys, values = _without_item(node.keys, k), _without_item(node.values, k)
            yield ("table" if place.name.isupper() else "memory"), ast.Dict(keys, values)


def _items(items: Sequence[ast.expr]) -> Iterator[tuple[Class, ast.AST | str]]:
    if not any(called(item) == "Row" for item in items):
        return
    for k in range(len(items)):
        yield "table", ast.Tuple(_without_item(items, k), ast.Load())
    for k in range(len(items) - 1):
        swapped = [*items[:k], items[k + 1], items[k], *items[k + 2 :]]
        yield "table", ast.Tuple(swapped, ast.Load())


def _word(word: str, place: Place) -> Iterator[tuple[Class, ast.AST | str]]:
    if place.keyword == "cond" and " or " in word:
        names = word.split(" or ")
        for k in range(len(names)):
            yield "table", repr(" or ".join(_without_item(names, k)))
    if place.calls and place.calls[0] in _EFFECT_CALLS and not place.form:
        for other in _following(word, _SWAPPED):
            yield "field", repr(other)


def _following(word: str, families: Sequence[Sequence[str]]) -> Iterator[str]:
    for family in families:
        if word in family:
            yield family[(family.index(word) + 1) % len(family)]


def _statement(node: ast.stmt, place: Place) -> Iterator[tuple[Class, ast.AST | str]]:
    match node:
        case ast.If(test, body, orelse) if not isinstance(test, ast.Compare | ast.UnaryOp):
            negated = ast.If(ast.Name(f"not ({ast.unparse(test)})"), body, orelse)
            yield "guard", ast.unparse(negated).replace("\n", "\n" + " " * node.col_offset)
        case ast.Expr(ast.Call()) | ast.Delete() | ast.Assign([ast.Attribute() | ast.Subscript()]):
            yield "memory", "pass"
        case ast.Return(ast.Constant(value)) if place.returns_bool:
            yield "guard", f"return {not value}"
        case ast.Return(ast.expr() as value) if place.returns_bool:
            if not isinstance(value, ast.Compare | ast.UnaryOp):
                yield "guard", f"return not ({ast.unparse(value)})"
        case ast.Return(ast.Attribute() | ast.BinOp() | ast.Subscript() as value):
            if place.name in TIMER_PLACES:
                for how in ("({}) + 1", "({}) - 1", "2 * ({})"):
                    yield "timer", f"return {how.format(ast.unparse(value))}"


def inner(node: ast.AST, place: Place) -> Iterator[tuple[ast.AST, Place]]:
    """The children of a node that may be changed, each with its place."""
    match node:
        case (
            ast.Assert() | ast.Raise() | ast.Import() | ast.ImportFrom() | ast.Expr(ast.Constant())
        ):
            return
        case ast.Call(ast.Name("_given")):
            return  # a default, which the kit never uses
        case ast.FunctionDef(name) if name in UNTOUCHED:
            return
        case ast.FunctionDef():
            returns_bool = node.returns is not None and ast.unparse(node.returns) == "bool"
            within = Place(node.name, place.form, returns_bool=returns_bool)
            for statement in node.body:
                yield statement, within
        case ast.ClassDef():
            for statement in node.body:
                yield statement, Place(node.name, place.form)
        case ast.AnnAssign(target, annotation, value):
            named = target.id if isinstance(target, ast.Name) else place.name
            if place.form:
                yield annotation, place
            if value is not None and not isinstance(value, ast.Constant):
                yield value, Place(place.name or named, place.form)
        case ast.Assign([ast.Name(name)], value) if not place.name:
            yield value, Place(name, place.form)
        case ast.Call():
            calls = (called(node), *place.calls)
            for value in [*([] if called(node) else [node.func]), *node.args]:
                yield value, Place(place.name, place.form, calls)
            if isinstance(node.func, ast.Attribute):
                yield node.func.value, Place(place.name, place.form, place.calls)
            for keyword in node.keywords:
                if keyword.arg in COSTS:
                    continue
                yield keyword.value, Place(place.name, place.form, calls, keyword.arg or "")
        case _:
            for child in ast.iter_child_nodes(node):
                if isinstance(child, ast.arguments | ast.expr_context | ast.operator | ast.cmpop):
                    continue
                yield child, place
