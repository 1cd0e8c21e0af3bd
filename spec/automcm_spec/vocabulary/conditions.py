"""The conditions that the compiled specification evaluates, recorded and flipped.

They cost nothing in automcm_spec/vocabulary/station.py. ``recording`` makes a copy of a station
from the same source, with a hook at every condition; its table ``CONDITIONS`` lists their places.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable, Collection, Iterator
from copy import copy
from functools import cache
from inspect import getsource
from textwrap import dedent
from typing import Any, NamedTuple, TypeAlias, TypeVar

EMPTY: frozenset[Any] = frozenset()
"""The empty set of any type."""


class NoArm(Exception):
    """No arm of a CASE holds; TLC would stop there."""


class Condition(NamedTuple):
    """An atomic condition of the specification, or the id of a rule.

    ``kind`` is ``guard`` (of an IF that chooses an outcome), ``case`` (of an arm of CASE), ``part``
    (inside a named condition, a set or a message) or ``rule``.
    """

    operator: str
    line: int
    """The line in the operator's module."""
    kind: str
    node: int
    """Its index in the method, in the order of ast.walk."""
    text: str
    """The text in the specification."""


Values: TypeAlias = "tuple[tuple[str, Any], ...]"
"""The TLA+ names and paths inside a condition with their values, without records."""
Hook: TypeAlias = "Callable[[Condition, bool, Callable[[], Values]], bool]"
"""Receives a condition, its value, and a function that returns the values inside it, which may be
called only at once. Returns the value to use instead. For a rule the value is true, and the
returned value is ignored."""
S = TypeVar("S")
T = TypeVar("T")


class Evaluated(NamedTuple):
    """An evaluated condition."""

    condition: Condition
    value: bool
    values: Values


def recording(station: S, hook: Hook) -> S:
    """A copy of a station that calls the hook at every condition.

    Raises TypeError if the station's class is not one of the compiled module.
    """
    made = type(station)
    module = sys.modules[made.__module__]
    if getattr(module, made.__name__, None) is not made or not hasattr(module, "CONDITIONS"):
        raise TypeError(f"{made.__name__} must be a class of the compiled module")
    recorded = copy(station)
    recorded.__class__ = _recording_class(made)  # type: ignore[arg-type]
    recorded._hook = hook  # type: ignore[attr-defined]
    return recorded


def record(
    station: S, query: Callable[[S], T], flipped: Collection[Condition] = ()
) -> tuple[T, list[Evaluated]]:
    """The result of ``query`` for the station, and the conditions evaluated on the way.

    The conditions in ``flipped`` are negated; ``value`` is their value before that.
    """
    evaluated: list[Evaluated] = []

    def hook(condition: Condition, value: bool, values: Callable[[], Values]) -> bool:
        evaluated.append(Evaluated(condition, value, values()))
        return value is not (condition in flipped)

    return query(recording(station, hook)), evaluated


def blocking_conditions(
    station: S,
    query: Callable[[S], T],
    wanted: Callable[[T], bool],
    most: int = 3,
    kind: str = "guard",
) -> list[list[Evaluated]]:
    """The smallest sets of guards to negate so that ``query`` returns a wanted result.

    Returns all smallest sets of at most ``most`` guards, each in evaluation order; [[]] if the
    result is wanted anyway, [] if there is no such set. ``kind`` is the kind of conditions to
    choose from: ``part`` for a query that no guard decides.
    """
    found: list[list[Evaluated]] = []
    tried: set[frozenset[Condition]] = {frozenset()}
    level = [frozenset[Condition]()]
    met: dict[Condition, None] = {}
    flipped: frozenset[Condition] = frozenset()

    def hook(condition: Condition, value: bool, values: Callable[[], Values]) -> bool:
        if condition.kind == kind:
            met[condition] = None
        return value is not (condition in flipped)

    hooked = recording(station, hook)
    for size in range(most + 1):
        following: list[frozenset[Condition]] = []
        for flipped in level:
            met.clear()
            if wanted(query(hooked)):
                _, evaluated = record(station, query, flipped)
                chosen = {t.condition: t for t in evaluated if t.condition in flipped}
                found.append([chosen[c] for c in met if c in flipped])
            for condition in met if size < most and not found else ():
                more = flipped | {condition}
                if len(more) > size and more not in tried:
                    tried.add(more)
                    following.append(more)
        if found:
            return found
        level = following
    return found


@cache
def _recording_class(made: type) -> type:
    """A subclass that calls ``_hook`` at every condition; each method is compiled at its first
    use."""
    module = sys.modules[made.__module__]
    rows: dict[str, dict[int, int]] = {}
    for row, condition in enumerate(module.CONDITIONS):
        rows.setdefault(_plain(condition.operator), {})[condition.node] = row
    names = {**vars(module), "_shown": _shown}
    methods = {
        name: method for each in reversed(made.__mro__) for name, method in vars(each).items()
    }
    lazy = {
        name: _Lazy(name, method, rows[_plain(name)], names)
        for name, method in methods.items()
        if _plain(name) in rows
    }
    return type(made.__name__, (made,), dict(lazy))


class _Lazy:
    """Stands for a method or a cached property until its first use."""

    def __init__(self, name: str, method: Any, rows: dict[int, int], names: dict[str, Any]) -> None:
        self._name, self._method, self._rows, self._names = name, method, rows, names

    def __get__(self, station: Any, owner: type) -> Any:
        function = getattr(self._method, "func", self._method)
        (method,) = ast.parse(dedent(getsource(function))).body
        nodes = ((self._rows.get(n), node) for n, node in enumerate(ast.walk(method)))
        _Hooks({id(node): row for row, node in nodes if row is not None}).visit(method)
        found: dict[str, Any] = {}
        module = ast.fix_missing_locations(ast.Module([method], []))
        exec(compile(module, function.__code__.co_filename, "exec"), self._names, found)
        (hooked,) = found.values()
        if hasattr(hooked, "__set_name__"):
            hooked.__set_name__(owner, self._name)
        setattr(owner, self._name, hooked)
        return getattr(station, self._name)


def _plain(name: str) -> str:
    """A name without case and underscores: equal for OnCamLoss and on_cam_loss."""
    return name.replace("_", "").lower()


def _shown(*pairs: tuple[str, Any]) -> Values:
    return tuple((text, value) for text, value in pairs if not hasattr(value, "_fields"))


class _Hooks(ast.NodeTransformer):
    """Wraps the hook around the nodes listed in ``rows``."""

    def __init__(self, rows: dict[int, int]) -> None:
        self._rows = rows

    def visit(self, node: ast.AST) -> ast.AST:
        """The node, or a call of the hook with the node."""
        row = self._rows.get(id(node))
        if row is None:
            return self.generic_visit(node)
        terms = ", ".join(f"({text!r}, {python})" for text, python in dict(_terms(node)).items())
        self.generic_visit(node)
        assert isinstance(node, ast.expr)
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            hook = f"(self._hook(CONDITIONS[{row}], True, lambda: ()), {node.value!r})[1]"
            return ast.copy_location(ast.parse(hook, mode="eval").body, node)
        hook = f"self._hook(CONDITIONS[{row}], 0, lambda: _shown({terms}))"
        call = ast.parse(hook, mode="eval").body
        assert isinstance(call, ast.Call)
        call.args[1] = node
        return ast.copy_location(call, node)


def _terms(node: ast.AST, bound: Collection[str] = ("self",)) -> Iterator[tuple[str, str]]:
    """The names and paths in a condition, in TLA+ and in Python, without names bound inside it."""
    if isinstance(node, (ast.GeneratorExp, ast.SetComp)):
        bound = {
            *bound,
            *(n.id for g in node.generators for n in ast.walk(g.target) if isinstance(n, ast.Name)),
        }
    if isinstance(node, ast.expr) and (text := _path(node, bound)):
        yield text, ast.unparse(node)
        return
    children = node.args if isinstance(node, ast.Call) else ast.iter_child_nodes(node)
    for child in children:
        yield from _terms(child, bound)


def _path(node: ast.expr, bound: Collection[str]) -> str:
    match node:
        case ast.Name(id=name):
            return "" if name in bound else name
        case ast.Attribute(value=ast.Name(id="self"), attr=name):
            return "".join(word.capitalize() for word in name.split("_"))
        case ast.Attribute(value=base, attr=name) if text := _path(base, bound):
            return f"{text}.{name}"
        case ast.Subscript(value=base, slice=ast.Constant(value=int(n))) if text := _path(
            base, bound
        ):
            return f"{text}[{n + 1}]"
    return ""
