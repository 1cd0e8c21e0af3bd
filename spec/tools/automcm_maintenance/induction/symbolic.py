"""Evaluates TLA+ expressions as parsed by SANY on symbolic values, for z3.

A number or a string is a Python value if it is known, else a z3 expression, where each string has a
number (``code``). A tuple is a tuple, a record a dict, a function a ``Fn``. A ``Set`` is a union of
parts ``{element : variables, guard}``; of a set that is not known, the guard is a predicate. So no
bound on the size of a set is needed. Sizes are not evaluated: see ``Evaluator.sizes``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, NamedTuple

import z3  # type: ignore[import-untyped]

from automcm_maintenance.compilation.sany import OTHER, Node, NotCompiled, ParsedModules

Value = Any
Env = Mapping[str, Any]

_CODES: dict[str, int] = {}
_FIRST_CODE = 1_000_000


def code(text: str) -> int:
    """The number that stands for a string."""
    return _CODES.setdefault(text, _FIRST_CODE + len(_CODES))


def sort_of(sample: Value) -> z3.SortRef:
    """The sort of the values in the form of this number, string or truth value."""
    return z3.BoolSort() if isinstance(sample, bool) else z3.IntSort()


def variables(sample: Value, name: str) -> tuple[Value, list[z3.ExprRef]]:
    """A value in the form of the sample with variables in it, and these."""
    found: list[z3.ExprRef] = []

    def fresh(value: Value) -> Value:
        if isinstance(value, dict):
            return {key: fresh(one) for key, one in value.items()}
        if isinstance(value, tuple):
            return tuple(map(fresh, value))
        found.append(z3.FreshConst(sort_of(value), name))
        return found[-1]

    return fresh(sample), found


class Unmergeable:
    """A value that is one of two of different form, which nothing may look at."""


def lift(value: Value) -> z3.ExprRef:
    """A number, truth value or string as a z3 expression."""
    if isinstance(value, bool):
        return z3.BoolVal(value)
    if isinstance(value, int):
        return z3.IntVal(value)
    return z3.IntVal(code(value)) if isinstance(value, str) else value


def all_of(values: Iterable[Value]) -> Value:
    """The conjunction, which stops at the first that is known to be false."""
    return _joined(values, False, z3.And)


def any_of(values: Iterable[Value]) -> Value:
    """The disjunction, which stops at the first that is known to be true."""
    return _joined(values, True, z3.Or)


def _joined(values: Iterable[Value], last: bool, join: Callable[[list[Value]], Value]) -> Value:
    rest = []
    for value in values:
        if value is last:
            return last
        if not isinstance(value, bool):
            rest.append(value)
    return not last if not rest else rest[0] if len(rest) == 1 else join(rest)


def negated(value: Value) -> Value:
    """Not the value."""
    if isinstance(value, bool):
        return not value
    return value.arg(0) if z3.is_not(value) else z3.Not(value)


def implied(test: Value, value: Callable[[], Value]) -> Value:
    """If the test holds, the value."""
    return True if test is False else any_of([negated(test), value()])


class Member(NamedTuple):
    """One part of a set: ``element`` for all values of the variables that satisfy the guard."""

    variables: tuple[z3.ExprRef, ...]
    guard: Value
    element: Value
    pattern: z3.ExprRef | None = None
    """The predicate of the guard, if that is one: z3 looks for its values."""


@dataclass(frozen=True)
class Set:
    """A union of parts. Each call of a part makes its variables anew."""

    parts: tuple[Callable[[], Member], ...] = ()

    def contains(self, value: Value) -> Value:
        """Whether the value is an element."""
        return any_of(_holds(part(), value) for part in self.parts)

    def exists(self, test: Callable[[Value], Value]) -> Value:
        """Whether the test holds for an element."""

        def one(part: Callable[[], Member]) -> Value:
            m = part()
            known = isinstance(m.guard, bool) or not m.variables
            return m.guard if known else z3.Exists(m.variables, m.guard)

        return any_of(map(one, self.where(test).parts))

    def every(self, test: Callable[[Value], Value]) -> Value:
        """Whether the test holds for all elements."""

        def one(part: Callable[[], Member]) -> Value:
            m = part()
            body = implied(m.guard, lambda: test(m.element))
            if isinstance(body, bool) or not m.variables:
                return body
            return z3.ForAll(
                m.variables, body, patterns=[m.pattern] if m.pattern is not None else []
            )

        return all_of(map(one, self.parts))

    def where(self, test: Callable[[Value], Value]) -> Set:
        """The elements for which the test holds."""

        def of(m: Member) -> Member:
            guard = False if m.guard is False else all_of([m.guard, test(m.element)])
            return m._replace(guard=guard)

        return self._each(of)

    def map(self, to: Callable[[Value], Value]) -> Set:
        """The set of the values of the elements."""
        return self._each(lambda m: m._replace(element=to(m.element)))

    def _each(self, change: Callable[[Member], Member]) -> Set:
        def made(part: Callable[[], Member]) -> Member:
            return change(part())

        return Set(tuple(partial(made, part) for part in self.parts))

    def union(self) -> Set:
        """The union of the elements, which are sets."""
        made = []
        for part in self.parts:
            first = part()
            if first.guard is not False:
                made += [_inner(part, n) for n in range(len(first.element.parts))]
        return Set(tuple(made))


def _inner(part: Callable[[], Member], n: int) -> Callable[[], Member]:
    def make() -> Member:
        outer = part()
        inner = outer.element.parts[n]()
        guard = all_of([outer.guard, inner.guard])
        return Member((*outer.variables, *inner.variables), guard, inner.element)

    return make


def elements(values: Iterable[Value]) -> Set:
    """The set of these values."""
    return Set(tuple(partial(Member, (), True, value) for value in values))


def _leaves(a: Value, b: Value) -> list[tuple[Value, Value]] | None:
    """The pairs of numbers, strings and truth values in two values of the same form, else None."""
    if isinstance(a, dict):
        if not isinstance(b, dict) or a.keys() != b.keys():
            return None
        a, b = tuple(a.values()), tuple(b[key] for key in a)
    if isinstance(a, tuple):
        if not isinstance(b, tuple) or len(a) != len(b):
            return None
        found: list[tuple[Value, Value]] = []
        for pair in zip(a, b, strict=True):
            inner = _leaves(*pair)
            if inner is None:
                return None
            found += inner
        return found
    return [(a, b)]


def _holds(m: Member, value: Value) -> Value:
    """Whether the value is an element of the part."""
    pairs = None if m.guard is False else _leaves(m.element, value)
    if pairs is None or any(equal(a, b) is False for a, b in pairs):
        return False
    chosen: list[tuple[z3.ExprRef, z3.ExprRef]] = []
    left: list[Value] = []
    for a, b in pairs:
        known = {v.get_id() for v, _ in chosen}
        if any(z3.is_expr(a) and a.eq(v) and v.get_id() not in known for v in m.variables):
            chosen.append((a, lift(b)))
        else:
            left.append(equal(a, b))
    body = all_of([m.guard, *left])
    if isinstance(body, bool):
        return body
    body = z3.substitute(body, *chosen)
    free = [v for v in m.variables if not any(v.eq(w) for w, _ in chosen)]
    return z3.Exists(free, body) if free else body


def equal(a: Value, b: Value) -> Value:
    """Whether two values are equal."""
    if isinstance(a, Set) and isinstance(b, Set):
        return all_of([a.every(b.contains), b.every(a.contains)])
    if isinstance(a, Unmergeable) or isinstance(b, Unmergeable):
        raise ValueError("a value of two forms is compared")
    if isinstance(a, dict | tuple):
        if isinstance(a, dict):
            if not isinstance(b, dict) or a.keys() != b.keys():
                return False
            a, b = tuple(a.values()), tuple(b[key] for key in a)
        if not isinstance(b, tuple) or len(a) != len(b):
            return False
        return all_of(equal(x, y) for x, y in zip(a, b, strict=True))
    if not z3.is_expr(a) and not z3.is_expr(b):
        return type(a) is type(b) and a == b
    a, b = lift(a), lift(b)
    return True if a.eq(b) else a == b


def choose(test: Value, a: Value, b: Value) -> Value:
    """IF test THEN a ELSE b."""
    if isinstance(test, bool):
        return a if test else b
    if a is b:
        return a
    if isinstance(a, Set):
        both = (a.where(lambda _: test), b.where(lambda _: negated(test)))
        return Set(tuple(part for s in both for part in s.parts))
    if isinstance(a, dict) and isinstance(b, dict) and a.keys() == b.keys():
        return {key: choose(test, a[key], b[key]) for key in a}
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return tuple(choose(test, x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, dict | tuple | Unmergeable) or isinstance(b, dict | tuple | Unmergeable):
        return Unmergeable()
    if not z3.is_expr(a) and not z3.is_expr(b) and type(a) is type(b) and a == b:
        return a
    a, b = lift(a), lift(b)
    return a if a.eq(b) else z3.If(test, a, b)


@dataclass(frozen=True)
class Fn:
    """A function."""

    of: Callable[[Value], Value]

    def put(self, key: Value, value: Value) -> Fn:
        """The function with another value of one argument."""
        return Fn(lambda k: choose(equal(k, key), value, self.of(k)))


@dataclass(frozen=True)
class _Size:
    """A number of which nothing is known: the size of a set that depends on these constants."""

    of: Mapping[int, z3.ExprRef]


def _size(found: Set) -> _Size:
    """Its constants may be variables of a quantifier around it."""
    constants: dict[int, z3.ExprRef] = {}
    for part in found.parts:
        m = part()
        inside = [lift(leaf) for leaf, _ in _leaves(m.element, m.element) or ()]
        stack = [lift(m.guard), *inside]
        seen: set[int] = set()
        while stack:
            node = stack.pop()
            if node.get_id() in seen:
                continue
            seen.add(node.get_id())
            stack += [node.body()] if z3.is_quantifier(node) else node.children()
            if z3.is_const(node) and node.decl().kind() == z3.Z3_OP_UNINTERPRETED:
                constants[node.get_id()] = node
        for variable in m.variables:
            constants.pop(variable.get_id(), None)
    return _Size(constants)


def any_truth(arguments: Sequence[z3.ExprRef]) -> Value:
    """An unknown truth value that may depend on these constants."""
    sorts = [x.sort() for x in arguments]
    return z3.FreshFunction(*sorts, z3.BoolSort())(*arguments) if sorts else z3.FreshBool("size")


@dataclass
class Evaluator:
    """Evaluates expressions of a specification with these constants and variables."""

    spec: ParsedModules
    constants: Mapping[str, Value]
    state: Mapping[str, Value] = field(default_factory=dict)
    after: Mapping[str, Value] = field(default_factory=dict)
    """The primed variables."""
    sizes: Callable[[Sequence[z3.ExprRef]], Value] = any_truth
    """The truth value of a comparison of the size of a set, which depends on these constants."""

    def operator(self, name: str, *args: Value) -> Value:
        """The value of an operator."""
        operator = self.spec.operators[name]
        return self.value(operator.body, dict(zip(operator.params, args, strict=True)))

    def value(self, node: Node, env: Env) -> Value:
        """The value of an expression. Raises sany.NotCompiled for an unsupported construct."""
        op, args = node.op, node.args
        match op:
            case "number":
                return int(node.name)
            case "string":
                return node.name
            case "TRUE" | "FALSE":
                return op == "TRUE"
            case "name":
                found = env[node.name]
                return found() if callable(found) else found
            case "constant":
                return self.constants[node.name]
            case "a variable":
                return self.state[node.name]
            case "'":
                return self._primed().value(args[0], env)
            case "call":
                operator = self.spec.operators[node.name]
                given = [self._lazy(arg, env) for arg in args]
                return self.value(operator.body, dict(zip(operator.params, given, strict=True)))
            case "let":
                for name, body in node.bounds:
                    env = {**env, name: self._lazy(body, env)}
                return self.value(args[0], env)
            case "\\land" | "$ConjList":
                return all_of(self.value(arg, env) for arg in args)
            case "\\lor" | "$DisjList":
                return any_of(self.value(arg, env) for arg in args)
            case "\\lnot":
                return negated(self.value(args[0], env))
            case "=>":
                return implied(self.value(args[0], env), lambda: self.value(args[1], env))
            case "=" | "/=":
                same = equal(self.value(args[0], env), self.value(args[1], env))
                return same if op == "=" else negated(same)
            case "$IfThenElse":
                return self._if(self.value(args[0], env), args[1], args[2], env)
            case "$Case":
                return self._case(args, env)
            case "<" | ">" | "\\leq" | "\\geq" | "+" | "-":
                return self._numbers(op, self.value(args[0], env), self.value(args[1], env))
            case "$Tuple":
                return tuple(self.value(arg, env) for arg in args)
            case "$RcdConstructor":
                return {p.args[0].name: self.value(p.args[1], env) for p in args}
            case "$RcdSelect":
                return self.value(args[0], env)[args[1].name]
            case "$FcnApply":
                base, index = (self.value(arg, env) for arg in args)
                return base.of(index) if isinstance(base, Fn) else base[index - 1]
            case "$FcnConstructor":
                (name, _) = node.bounds[0]
                return Fn(lambda key: self.value(args[0], {**env, name: key}))
            case "$Except":
                return self._except(node, env)
            case "$BoundedExists" | "$BoundedForall":
                return self._quantifier(node, list(node.bounds), env)
        return self._set(node, env)

    def _set(self, node: Node, env: Env) -> Value:
        op, args = node.op, node.args
        match op:
            case "Nat":
                return _numbers_from(0, None)
            case "..":
                return _numbers_from(self.value(args[0], env), self.value(args[1], env))
            case "$SetEnumerate":
                return elements([self.value(arg, env) for arg in args])
            case "\\in" | "\\notin":
                found = self.value(args[1], env).contains(self.value(args[0], env))
                return found if op == "\\in" else negated(found)
            case "\\subseteq":
                return self.value(args[0], env).every(self.value(args[1], env).contains)
            case "\\union":
                return Set(tuple(part for arg in args for part in self.value(arg, env).parts))
            case "\\intersect":
                return self.value(args[0], env).where(self.value(args[1], env).contains)
            case "\\":
                without = self.value(args[1], env)
                return self.value(args[0], env).where(lambda x: negated(without.contains(x)))
            case "UNION":
                return self.value(args[0], env).union()
            case "$SubsetOf":
                ((name, where),) = node.bounds
                return self.value(where, env).where(lambda x: self.value(args[0], {**env, name: x}))
            case "$SetOfAll":
                return self._all(args[0], list(node.bounds), env)
            case "Cardinality":
                return _size(self.value(args[0], env))
        raise NotCompiled(op, node.at)

    def _primed(self) -> Evaluator:
        return Evaluator(self.spec, self.constants, self.after, {}, self.sizes)

    def _lazy(self, node: Node, env: Env) -> Value:
        """A value that is computed when it is needed first."""
        return cache(partial(self.value, node, env))

    def _if(self, test: Value, a: Node, b: Node, env: Env) -> Value:
        if isinstance(test, bool):
            return self.value(a if test else b, env)
        return choose(test, self.value(a, env), self.value(b, env))

    def _case(self, arms: Sequence[Node], env: Env) -> Value:
        test, value = arms[0].args
        if test.op == OTHER:
            return self.value(value, env)
        holds = self.value(test, env)
        if holds is True or (len(arms) == 1 and holds is not False):
            return self.value(value, env)
        if len(arms) == 1:
            raise ValueError(f"{test.at}: no arm of CASE holds")
        if holds is False:
            return self._case(arms[1:], env)
        return choose(holds, self.value(value, env), self._case(arms[1:], env))

    def _numbers(self, op: str, a: Value, b: Value) -> Value:
        if isinstance(a, _Size) or isinstance(b, _Size):
            of = {id_: c for x in (a, b) if isinstance(x, _Size) for id_, c in x.of.items()}
            return _Size(of) if op in "+-" else self.sizes(tuple(of.values()))
        match op:
            case "<":
                return a < b
            case ">":
                return a > b
            case "\\leq":
                return a <= b
            case "\\geq":
                return a >= b
            case "+":
                return a + b
        return a - b

    def _except(self, node: Node, env: Env) -> Value:
        made = self.value(node.args[0], env)
        for pair in node.args[1:]:
            steps, value = pair.args
            (step,) = steps.args
            if isinstance(made, Fn):
                made = made.put(self.value(step, env), self.value(value, env))
            else:
                made = {**made, step.name: self.value(value, env)}
        return made

    def _quantifier(self, node: Node, bounds: list[tuple[str, Node]], env: Env) -> Value:
        if not bounds:
            return self.value(node.args[0], env)
        (name, where), *rest = bounds
        found = self.value(where, env)
        each = found.exists if node.op == "$BoundedExists" else found.every
        return each(lambda x: self._quantifier(node, rest, {**env, name: x}))

    def _all(self, body: Node, bounds: list[tuple[str, Node]], env: Env) -> Value:
        (name, where), *rest = bounds
        found = self.value(where, env)
        if not rest:
            return found.map(lambda x: self.value(body, {**env, name: x}))
        return found.map(lambda x: self._all(body, rest, {**env, name: x})).union()


def _numbers_from(first: Value, last: Value) -> Set:
    def make() -> Member:
        n = z3.FreshInt("n")
        bounds = [n >= first] if last is None else [n >= first, n <= last]
        return Member((n,), z3.And(bounds), n)

    return Set((make,))
