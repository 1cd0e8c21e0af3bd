"""The types of TLA+ expressions, as far as the compiled subset needs them.

TLA+ has no types, and TLC stops when it compares values of different types. Python returns False,
and treats TRUE like 1 and a record like a tuple. So the compiler infers the type of every
expression from the types of a few root operators, and rejects comparing or mixing different types.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import TypeAlias

from automcm_maintenance.compilation.sany import OTHER, Node, NotCompiled, Operator, ParsedModules
from automcm_spec.model_checking.tlc import Location

TAG = "kind"
"""The field that distinguishes records in one set."""


@dataclass(frozen=True)
class Basic:
    """An integer, a truth value, or Never: the element type of the empty set."""

    name: str


@dataclass(frozen=True)
class Str:
    """A string, with its possible values."""

    literals: frozenset[str]


@dataclass(frozen=True)
class SetOf:
    """A finite set; ``item`` is NEVER for a set that is always empty."""

    item: Type


@dataclass(frozen=True)
class Tup:
    """A tuple."""

    items: tuple[Type, ...]


@dataclass(frozen=True)
class Alt:
    """Tuples of different forms, which differ in length or in their first string."""

    forms: frozenset[Tup]


@dataclass(frozen=True)
class Rec:
    """A record of one of these classes."""

    classes: frozenset[str]


Type: TypeAlias = Basic | Str | SetOf | Tup | Alt | Rec
INT, BOOL, NEVER = Basic("int"), Basic("bool"), Basic("Never")
ID, NUMBER, LITERAL = Basic("id"), Basic("number"), Basic("literal")
"""Kinds of integers that data_independence distinguishes; a literal may be of any kind."""


class IncomparableTypes(Exception):
    """Two types without a common value, which TLC cannot compare."""


def join(a: Type, b: Type) -> Type:
    """The common type of values of either type. Raises IncomparableTypes."""
    if NEVER in (a, b):
        return b if a == NEVER else a
    if LITERAL in (a, b) and {a, b} <= {INT, ID, NUMBER, LITERAL}:
        return b if a == LITERAL else a
    match a, b:
        case Str(x), Str(y):
            return Str(x | y)
        case SetOf(x), SetOf(y):
            return SetOf(join(x, y))
        case Rec(x), Rec(y):
            return Rec(x | y)
        case (Tup() | Alt(), Tup() | Alt()):
            return _tuples([*_forms(a), *_forms(b)])
    if a != b:
        raise IncomparableTypes(f"{a} and {b}")
    return a


def _forms(t: Type) -> Sequence[Tup]:
    return [t] if isinstance(t, Tup) else sorted(t.forms, key=repr) if isinstance(t, Alt) else []


def _tuples(forms: Sequence[Tup]) -> Type:
    found: list[Tup] = []
    # No tuple has an element of the empty set.
    for form in [form for form in forms if NEVER not in form.items] or forms[:1]:
        for n, other in enumerate(found):
            if len(other.items) != len(form.items):
                continue
            try:
                found[n] = Tup(tuple(map(join, other.items, form.items)))
                break
            except IncomparableTypes:
                a, b = other.items[0], form.items[0]
                if not (isinstance(a, Str) and isinstance(b, Str)) or a.literals & b.literals:
                    raise
        else:
            found.append(form)
    return found[0] if len(found) == 1 else Alt(frozenset(found))


@dataclass
class Class:
    """A class of records with equal fields, and the place where one is first made."""

    name: str
    at: Location
    fields: dict[str, Type]


@dataclass
class Signature:
    """The types of an operator's parameters and result."""

    params: list[Type]
    result: Type


_NUMBERS: Mapping[str, Type] = {
    **dict.fromkeys(("+", "-"), INT),
    **dict.fromkeys(("<", ">", "\\leq", "\\geq"), BOOL),
    "..": SetOf(INT),
}
_LOGIC = {"\\land", "\\lor", "\\lnot", "=>", "$ConjList", "$DisjList"}
_CONJUNCTION = {"\\land", "$ConjList"}
_SETS = {"\\union", "\\intersect", "\\"}
_BINDERS = {"$SetOfAll", "$SubsetOf", "$BoundedExists", "$BoundedForall"}

Env: TypeAlias = Mapping[str, Type]
"""The types of names, and of paths such as ``i.timer`` that a test has narrowed."""


def path(node: Node) -> str | None:
    """``st.session[1]``: the text of a name, or of a selection from one."""
    if node.op in ("name", "constant"):
        return node.name
    if node.op in ("$RcdSelect", "$FcnApply") and (base := path(node.args[0])) is not None:
        step = node.args[1].name
        return f"{base}.{step}" if node.op == "$RcdSelect" else f"{base}[{step}]"
    return None


@dataclass
class Types:
    """Infers types. ``names`` maps an operator to the class of the records it makes, if they
    differ."""

    spec: ParsedModules
    constants: Mapping[str, Type]
    names: Mapping[str, str]
    classes: dict[str, Class] = field(default_factory=dict)
    signatures: dict[str, Signature] = field(default_factory=dict)
    partial: set[Location] = field(default_factory=set)
    """Selections that not every possible value supports."""
    made: dict[Location, str] = field(default_factory=dict)
    """The class of the record made at a place."""
    _known: dict[tuple[str, tuple[Type, ...]], Type] = field(default_factory=dict)
    _inside: str = ""
    _mixed: dict[frozenset[str], Location] = field(default_factory=dict)

    def infer(self, roots: Mapping[str, Sequence[str]]) -> None:
        """Infer the types of all expressions that these operators need.

        The types of their parameters are ``given``. Raises NotCompiled.
        """
        before = None
        while before != (now := {name: dict(c.fields) for name, c in self.classes.items()}):
            before = now
            self._known.clear()
            for name, params in roots.items():
                self._apply(self._operator(name), [self.given(text) for text in params])
        for classes, at in self._mixed.items():
            self._check_distinguishable(classes, at)

    def _operator(self, name: str) -> Operator:
        if name not in self.spec.operators:
            raise NotCompiled(f"no operator {name}", Location("", 0, 0, 0, 0))
        return self.spec.operators[name]

    def given(self, text: str) -> Type:
        """``int``; an operator without parameters, or an earlier root, for the type of its value;
        ``*`` and an operator, for the type of the elements of its value."""
        if text == "int":
            return INT
        operator = self._operator(text.removeprefix("*"))
        if operator.params and operator.name in self.signatures:
            return self.signatures[operator.name].result
        found = self._apply(operator, [])
        if not text.startswith("*"):
            return found
        assert isinstance(found, SetOf)
        return found.item

    def _check_distinguishable(self, classes: frozenset[str], at: Location) -> None:
        seen: set[str] = set()
        for name in classes:
            first = next(iter(self.classes[name].fields.values()))
            if not isinstance(first, Str) or first.literals & seen:
                raise NotCompiled(f"records that no tag distinguishes: {sorted(classes)}", at)
            seen |= first.literals

    def _apply(self, operator: Operator, args: list[Type], call: Node | None = None) -> Type:
        """The type of the operator's value; all its callers must give the same types."""
        call = call or operator.body
        key = operator.name, tuple(args)
        if key not in self._known:
            outside, self._inside = self._inside, operator.name
            result = self.of(operator.body, dict(zip(operator.params, args, strict=True)))
            self._inside = outside
            self._known[key] = result
            signature = self.signatures.setdefault(operator.name, Signature(args, result))
            both = zip(signature.params, args, strict=True)
            signature.params = [self._join(a, b, call) for a, b in both]
            signature.result = self._join(signature.result, result, call)
        return self._known[key]

    def _join(self, a: Type, b: Type, node: Node) -> Type:
        try:
            joined = join(a, b)
        except IncomparableTypes as error:
            raise NotCompiled(f"values of different types: {error}", node.at) from None
        if isinstance(joined, Rec) and len(joined.classes) > 1:
            self._mixed.setdefault(joined.classes, node.at)
        return joined

    def _common(self, types: Iterable[Type], node: Node) -> Type:
        return reduce(lambda a, b: self._join(a, b, node), types)

    def _all(self, nodes: Sequence[Node], env: Env) -> Type:
        return self._common([self.of(node, env) for node in nodes], nodes[0])

    def _must(self, node: Node, env: Env, wanted: Type) -> None:
        if self.of(node, env) not in (wanted, NEVER):
            raise NotCompiled(f"values of different types: must be {wanted}", node.at)

    def _item(self, node: Node, env: Env) -> Type:
        """The type of the elements of a set."""
        return self._element(self.of(node, env), node)

    def _element(self, found: Type, node: Node) -> Type:
        if isinstance(found, SetOf):
            return found.item
        if found != NEVER:
            raise NotCompiled(f"values of different types: must be a set, not {found}", node.at)
        return NEVER

    def of(self, node: Node, env: Env) -> Type:
        """The type of an expression. Raises NotCompiled with the construct and its line."""
        where = path(node)
        if where is not None and where in env:
            return env[where]
        op, args = node.op, node.args
        if op in _LOGIC:
            return self._logic(node, env)
        if op in _BINDERS:
            return self._binder(node, env)
        if op in _NUMBERS:
            for arg in args:
                self._must(arg, env, INT)
            return _NUMBERS[op]
        if op in _SETS:
            self._item(args[0], env)
            return self._all(args, env)
        match op:
            case "number":
                return INT
            case "string":
                return Str(frozenset({node.name}))
            case "TRUE" | "FALSE":
                return BOOL
            case "BOOLEAN":
                return SetOf(BOOL)
            case "constant" if node.name in self.constants:
                return self.constants[node.name]
            case "call":
                given = [self.of(arg, env) for arg in args]
                return self._apply(self._operator(node.name), given, node)
            case "let":
                for name, body in node.bounds:
                    env = {**env, name: self.of(body, env)}
                return self.of(args[0], env)
            case "=" | "/=" | "\\subseteq":
                self._all(args, env)
                return BOOL
            case "\\in" | "\\notin":
                self._join(SetOf(self.of(args[0], env)), self.of(args[1], env), node)
                return BOOL
            case "Cardinality":
                self._item(args[0], env)
                return INT
            case "UNION":
                return SetOf(self._element(self._item(args[0], env), node))
            case "$CartesianProd":
                return SetOf(Tup(tuple(self._item(arg, env) for arg in args)))
            case "$SetEnumerate":
                return SetOf(self._all(args, env) if args else NEVER)
            case "$Tuple":
                return Tup(tuple(self.of(arg, env) for arg in args))
            case "$IfThenElse":
                self._must(args[0], env, BOOL)
                then = self.of(args[1], self._narrow(args[0], env))
                return self._join(then, self.of(args[2], env), node)
            case "$Case":
                return self._case(node, env)
            case "$RcdConstructor":
                return self._record(node, env)
            case "$RcdSelect":
                return self._select(node, env)
            case "$FcnApply":
                return self._index(node, env)
            case "$Except":
                return self._except(node, env)
        raise NotCompiled(op, node.at)

    def _logic(self, node: Node, env: Env) -> Type:
        for arg in node.args:
            self._must(arg, env, BOOL)
            if node.op in _CONJUNCTION or node.op == "=>":
                env = self._narrow(arg, env)
        return BOOL

    def _binder(self, node: Node, env: Env) -> Type:
        inner = {**env, **{name: self._item(where, env) for name, where in node.bounds}}
        if node.op == "$SetOfAll":
            return SetOf(self.of(node.args[0], inner))
        self._must(node.args[0], inner, BOOL)
        return self.of(node.bounds[0][1], env) if node.op == "$SubsetOf" else BOOL

    def _narrow(self, test: Node, env: Env) -> Env:
        """The types that hold if a test is true: which record, which tuple it is."""
        if test.op in _CONJUNCTION:
            for arg in test.args:
                env = self._narrow(arg, env)
        if test.op != "=" or test.args[1].op != "string" or not test.args[0].args:
            return env
        literal, chosen = test.args[1].name, test.args[0]
        base = chosen.args[0]
        where = path(base)
        if where is None or chosen.op not in ("$RcdSelect", "$FcnApply"):
            return env
        found = self.of(base, env)
        step = chosen.args[1].name
        # Only tests that distinguish the values of a set; NEVER if no value is left.
        if isinstance(found, Rec) and step == TAG:
            tags = {name: self.classes[name].fields.get(TAG) for name in found.classes}
            left = frozenset(name for name, tag in tags.items() if _can_be(tag, literal))
            return {**env, where: Rec(left) if left else NEVER}
        if isinstance(found, Tup | Alt) and step == "1":
            forms = [f for f in _forms(found) if f.items and _can_be(f.items[0], literal)]
            return {**env, where: _tuples(forms) if forms else NEVER}
        return env

    def _case(self, node: Node, env: Env) -> Type:
        found: Type = NEVER
        for arm in node.args:
            test, value = arm.args
            if test.op != OTHER:
                self._must(test, env, BOOL)
            found = self._join(found, self.of(value, self._narrow(test, env)), value)
        return found

    def _record(self, node: Node, env: Env) -> Type:
        fields = {pair.args[0].name: self.of(pair.args[1], env) for pair in node.args}
        same = [c for c in self.classes.values() if list(c.fields) == list(fields)]
        tag = fields.get(TAG)
        if isinstance(tag, Str):
            same = [c for c in same if c.fields[TAG] == tag]
        if not same:
            name = self.names.get(self._inside, self._inside)
            if isinstance(tag, Str) and len(tag.literals) == 1:
                name = next(iter(tag.literals)).capitalize()
            if name in self.classes:
                raise NotCompiled(f"two classes of records with the name {name}", node.at)
            same = [Class(name, node.at, dict(fields))]
            self.classes[name] = same[0]
        for name, one in fields.items():
            same[0].fields[name] = self._join(same[0].fields[name], one, node)
        self.made[node.at] = same[0].name
        return Rec(frozenset({same[0].name}))

    def _select(self, node: Node, env: Env) -> Type:
        found, step = self.of(node.args[0], env), node.args[1].name
        if found == NEVER:
            return NEVER
        if not isinstance(found, Rec):
            raise NotCompiled(f"values of different types: must be a record, not {found}", node.at)
        fields = [
            self.classes[name].fields[step]
            for name in sorted(found.classes)
            if step in self.classes[name].fields
        ]
        if not fields:
            raise NotCompiled(f"a record without a field {step}", node.at)
        if len(fields) < len(found.classes):
            self.partial.add(node.at)
        return self._common(fields, node)

    def _index(self, node: Node, env: Env) -> Type:
        base, index = node.args
        if index.op != "number":
            raise NotCompiled("a function applied to an argument that is not a number", node.at)
        found = self.of(base, env)
        if found == NEVER:
            return NEVER
        forms = [f for f in _forms(found) if int(index.name) <= len(f.items)]
        if not forms:
            raise NotCompiled(f"no tuple with {index.name} elements", node.at)
        if len(forms) < len(_forms(found)):
            self.partial.add(node.at)
        return self._common((form.items[int(index.name) - 1] for form in forms), node)

    def _except(self, node: Node, env: Env) -> Type:
        base = self.of(node.args[0], env)
        for pair in node.args[1:]:
            (step, *further), value = pair.args[0].args, pair.args[1]
            if step.op != "string":
                raise NotCompiled("EXCEPT of a function", pair.at)
            if further:
                raise NotCompiled("EXCEPT of a field of a field", pair.at)
            if not isinstance(base, Rec) or len(base.classes) != 1:
                raise NotCompiled("EXCEPT of a value that is not one record", pair.at)
            fields = self.classes[next(iter(base.classes))].fields
            if step.name not in fields:
                raise NotCompiled(f"a record without a field {step.name}", pair.at)
            fields[step.name] = self._join(fields[step.name], self.of(value, env), pair)
        return base


def _can_be(t: Type | None, literal: str) -> bool:
    return isinstance(t, Str) and literal in t.literals
