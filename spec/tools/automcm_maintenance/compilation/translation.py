"""Translates TLA+ expressions to Python expressions, and operators to methods.

LET and CASE are only compiled where they are the value of an operator or of a branch of one.
Evaluation is as lazy as in TLA+. A LET definition is bound where it is certainly needed, and
substituted where it may not be. An operator is inlined if an argument could fail or is expensive
and the operator does not always need it.

Conditions are marked for automcm_spec.vocabulary.conditions: ``_mark(n, condition)`` has the value
of the condition.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from automcm_maintenance.compilation.sany import OTHER, Node, NotCompiled, Operator
from automcm_maintenance.compilation.tla_types import BOOL, Type, Types
from automcm_spec.vocabulary.conditions import Condition
from automcm_spec.vocabulary.tla_names import local, snake

BINARY = {
    "=": "==",
    "/=": "!=",
    "<": "<",
    ">": ">",
    "\\leq": "<=",
    "\\geq": ">=",
    "\\in": "in",
    "\\notin": "not in",
    "\\subseteq": "<=",
    "+": "+",
    "-": "-",
    "\\union": "|",
    "\\intersect": "&",
    "\\": "-",
}
AND, OR = {"\\land", "$ConjList"}, {"\\lor", "$DisjList"}
LOGIC = {*AND, *OR, "\\lnot", "=>"}
SURE = {
    "number",
    "string",
    "TRUE",
    "FALSE",
    "constant",
    "name",
    "$Tuple",
    "$RcdSelect",
    "$FcnApply",
}
"""Constructs that cost next to nothing."""
MARK = "_mark"
RULE = re.compile(r"[A-Z]{3}-\d+")
"""Matches a string that is a rule id."""


@dataclass
class Translator:
    """Translates the bodies of operators; ``rows`` are the marked conditions."""

    types: Types
    sources: Mapping[str, Sequence[str]]
    """The lines of each module."""
    decision: Type | None = None
    """The type of value of the operators whose IF conditions are guards."""
    rows: list[Condition] = field(default_factory=list)
    _strict: dict[tuple[str, str], bool] = field(default_factory=dict)
    _operator: str = ""
    _result: Type = BOOL

    def method(self, operator: Operator, head: str) -> ast.stmt:
        """The syntax tree of the method with this first line, without marks."""
        self._operator, first = operator.name, len(self.rows)
        self._result = self.types.signatures[operator.name].result
        lines = self.statements(operator.body, ())
        text = "\n".join([head, f'    """{operator.at.module}.tla:{operator.at.line}."""', *lines])
        tree, unmarked = ast.parse(text).body[0], _Unmark()
        unmarked.visit(tree)
        for n, node in enumerate(ast.walk(tree)):
            for row in unmarked.found.get(id(node), ()):
                self.rows[row] = self.rows[row]._replace(node=n)
        self.rows[first:] = sorted(self.rows[first:], key=lambda row: (row.line, row.node))
        return tree

    def statements(self, node: Node, pending: Sequence[tuple[str, Node]]) -> list[str]:
        """The lines that return the value; ``pending`` are LET definitions not needed so far."""
        if node.op == "let":
            return self.statements(node.args[0], (*pending, *node.bounds))
        if node.op == "$IfThenElse":
            lines, test, pending = self._bind(node.args[0], pending)
            lines.append(f"    if {self.condition(test, 'guard')}:")
            lines += ["    " + line for line in self.statements(node.args[1], pending)]
            return lines + self.statements(node.args[2], pending)
        if node.op == "$Case":
            return self._case(node, pending)
        lines, value, _ = self._bind(node, pending)
        text = self.condition(value, "part") if self._result == BOOL else self.expression(value)
        return [*lines, f"    return {text}"]

    def _case(self, node: Node, pending: Sequence[tuple[str, Node]]) -> list[str]:
        lines: list[str] = []
        for arm in node.args:
            if arm.args[0].op == OTHER:
                return lines + self.statements(arm.args[1], pending)
            bound, test, pending = self._bind(arm.args[0], pending)
            lines += [*bound, f"    if {self.condition(test, 'case')}:"]
            lines += ["    " + line for line in self.statements(arm.args[1], pending)]
        where = f"{node.at.module}.tla:{node.at.line}"
        return [*lines, f"    raise NoArm({where!r})"]

    def _bind(
        self, node: Node, pending: Sequence[tuple[str, Node]]
    ) -> tuple[list[str], Node, Sequence[tuple[str, Node]]]:
        """Bind the definitions that the expression certainly needs; substitute those it may
        need."""
        bound: list[tuple[str, Node]] = []
        left: list[tuple[str, Node]] = []
        for name, value in reversed(pending):
            needed = [node, *(other for _, other in bound)]
            if any(self.needs(other, name) for other in needed):
                bound.insert(0, (name, value))
                continue
            node = node.put({name: value})
            bound = [(other, body.put({name: value})) for other, body in bound]
            left.insert(0, (name, value))
        lines = [f"    {local(name)} = {self.expression(value)}" for name, value in bound]
        return lines, node, left

    def needs(self, node: Node, name: str) -> bool:
        """Whether the value of the expression always depends on the name."""
        if node.op == "name":
            return node.name == name
        if node.op == "$IfThenElse":
            test, then, other = node.args
            return self.needs(test, name) or (self.needs(then, name) and self.needs(other, name))
        if node.op in LOGIC:
            return self.needs(node.args[0], name)
        if node.bounds and node.op != "let":
            return self.needs(node.bounds[0][1], name)
        if node.op == "call":
            both = zip(node.args, self.types.spec.operators[node.name].params, strict=True)
            return any(self.needs(arg, name) and self._always(node, param) for arg, param in both)
        return any(self.needs(arg, name) for arg in node.args)

    def _always(self, call: Node, param: str) -> bool:
        """Whether the operator always needs the parameter."""
        key = call.name, param
        if key not in self._strict:
            self._strict[key] = self.needs(self.types.spec.operators[call.name].body, param)
        return self._strict[key]

    def _sure(self, node: Node) -> bool:
        """Whether evaluating the expression cannot fail and costs next to nothing."""
        return all(
            part.op in SURE or (part.op == "call" and not part.args) for part in node.walk()
        ) and self._total(node)

    def _total(self, node: Node) -> bool:
        """Whether the expression has a value for all values of its names."""
        return all(
            part.op != "$Case"
            and part.at not in self.types.partial
            and (part.op != "call" or self._total(self.types.spec.operators[part.name].body))
            for part in node.walk()
        )

    def condition(self, node: Node, kind: str) -> str:
        """A truth value; its atomic conditions are marked."""
        for ops, word in ((AND, " and "), (OR, " or ")):
            if node.op in ops:
                return f"({word.join(self.condition(part, kind) for part in _flat(node, ops))})"
        if node.op == "=>":
            first, second = (self.condition(arg, kind) for arg in node.args)
            return f"((not {first}) or {second})"
        if node.op == "\\lnot":
            return f"(not {self.condition(node.args[0], kind)})"
        if node.op in ("TRUE", "FALSE"):
            return self.expression(node)
        return self._mark(node, kind, self.text(node), self.expression(node))

    def _mark(self, node: Node, kind: str, text: str, python: str) -> str:
        if kind == "guard" and self._result != self.decision:
            kind = "part"
        self.rows.append(Condition(self._operator, node.at.line, kind, 0, text))
        return f"{MARK}({len(self.rows) - 1}, {python})"

    def text(self, node: Node) -> str:
        """The text of the expression in the module."""
        at = node.at
        lines = list(self.sources[at.module][at.line - 1 : at.end_line])
        lines[-1] = lines[-1][: at.end_column]
        lines[0] = lines[0][at.column - 1 :]
        return " ".join(" ".join(line.partition("\\*")[0].split()) for line in lines).strip()

    def expression(self, node: Node) -> str:
        """A Python expression in parentheses, or one that needs none."""
        op, args = node.op, node.args
        if op in LOGIC:
            return self.condition(node, "part")
        if op in ("=", "/=") and any(_is_empty(arg) for arg in args):
            other = args[0] if _is_empty(args[1]) else args[1]
            return f"({'not ' if op == '=' else 'bool'}({self.expression(other)}))"
        if op in ("\\in", "\\notin"):
            return f"({self.expression(args[0])} {BINARY[op]} {self._range(args[1], '{}')})"
        if op in BINARY:
            return f"({self.expression(args[0])} {BINARY[op]} {self.expression(args[1])})"
        match op:
            case "number":
                return node.name
            case "string" if RULE.fullmatch(node.name):
                return self._mark(node, "rule", node.name, repr(node.name))
            case "string":
                return repr(node.name)
            case "TRUE" | "FALSE":
                return op.capitalize()
            case "BOOLEAN":
                return "frozenset({False, True})"
            case "name":
                return local(node.name)
            case "constant":
                return f"self.{snake(node.name)}"
            case "call":
                return self._call(node)
            case "Cardinality":
                return f"len({self.expression(args[0])})"
            case "$Tuple":
                return f"({''.join(self.expression(arg) + ', ' for arg in args)})"
            case "$RcdSelect":
                return f"{self.expression(args[0])}.{local(args[1].name)}"
            case "$FcnApply":
                return f"{self.expression(args[0])}[{int(args[1].name) - 1}]"
            case "$RcdConstructor":
                return self._record(node)
            case "$Except":
                return self._except(node)
            case "$IfThenElse":
                text = self.condition(args[0], "guard")
                return f"({self.expression(args[1])} if {text} else {self.expression(args[2])})"
            case "$BoundedExists" | "$BoundedForall":
                word = "any" if op == "$BoundedExists" else "all"
                return f"{word}({self.condition(args[0], 'part')} {self._loops(node)})"
        return self._set(node)

    def _set(self, node: Node) -> str:
        op, args = node.op, node.args
        match op:
            case "..":
                return f"frozenset({self._range(node, '()')})"
            case "$SetEnumerate":
                items = ", ".join(map(self.expression, args))
                return f"frozenset({{{items}}})" if items else "EMPTY"
            case "$SetOfAll" | "$SubsetOf":
                return f"frozenset({{{self._each(node)}}})"
            case "UNION" if args[0].op == "$SetEnumerate" and args[0].args:
                return "(" + " | ".join(map(self.expression, args[0].args)) + ")"
            case "UNION":
                return f"frozenset(chain.from_iterable({self._range(args[0], '()')}))"
            case "$CartesianProd":
                return f"frozenset(product({', '.join(map(self.expression, args))}))"
        raise NotCompiled(op, node.at)

    def _range(self, node: Node, brackets: str) -> str:
        """A set that is only iterated over."""
        if node.op == "..":
            first, last = map(self.expression, node.args)
            return f"range({first}, {last} + 1)"
        if node.op == "$SetEnumerate" and node.args:
            return brackets[0] + "".join(self.expression(a) + ", " for a in node.args) + brackets[1]
        if node.op in ("$SetOfAll", "$SubsetOf"):
            return f"({self._each(node)})"
        return self.expression(node)

    def _each(self, node: Node) -> str:
        """The inside of a comprehension."""
        if node.op == "$SetOfAll":
            return f"{self.expression(node.args[0])} {self._loops(node)}"
        test = self.condition(node.args[0], "part")
        return f"{local(node.bounds[0][0])} {self._loops(node)} if {test}"

    def _loops(self, node: Node) -> str:
        return " ".join(
            f"for {local(name)} in {self._range(where, '()')}" for name, where in node.bounds
        )

    def _call(self, node: Node) -> str:
        operator = self.types.spec.operators[node.name]
        if not operator.params:
            return f"self.{snake(node.name)}"
        for arg, param in zip(node.args, operator.params, strict=True):
            if not self._sure(arg) and not self._always(node, param):
                return self._expanded(node, operator)
        return f"self.{snake(node.name)}({', '.join(map(self.expression, node.args))})"

    def _expanded(self, node: Node, operator: Operator) -> str:
        bound = {name for part in operator.body.walk() for name, _ in part.bounds}
        free = {part.name for arg in node.args for part in arg.walk() if part.op == "name"}
        if bound & free:
            raise NotCompiled(
                f"an argument of {node.name} with a name that is bound there", node.at
            )
        return self.expression(
            operator.body.put(dict(zip(operator.params, node.args, strict=True)))
        )

    def _record(self, node: Node) -> str:
        pairs = [pair.args for pair in node.args]
        fields = [f"{local(name.name)}={self.expression(value)}" for name, value in pairs]
        return f"{self.types.made[node.at]}({', '.join(fields)})"

    def _except(self, node: Node) -> str:
        base = self.expression(node.args[0])
        fields: dict[str, str] = {}
        for pair in node.args[1:]:
            (step,), value = pair.args[0].args, pair.args[1]
            if (name := local(step.name)) in fields:
                raise NotCompiled("EXCEPT changes a field twice", pair.at)
            fields[name] = self.expression(value)
        return f"{base}._replace({', '.join(f'{n}={v}' for n, v in fields.items())})"


class _Unmark(ast.NodeTransformer):
    """Removes the marks; ``found`` are their numbers by the id of the marked node."""

    def __init__(self) -> None:
        self.found: dict[int, list[int]] = {}

    def visit_Call(self, node: ast.Call) -> ast.AST:
        """Replace a mark by the marked expression."""
        self.generic_visit(node)
        if not (isinstance(node.func, ast.Name) and node.func.id == MARK):
            return node
        number, marked = node.args
        assert isinstance(number, ast.Constant) and isinstance(number.value, int)
        self.found.setdefault(id(marked), []).append(number.value)
        return marked


def _flat(node: Node, ops: set[str]) -> list[Node]:
    if node.op not in ops:
        return [node]
    return [part for arg in node.args for part in _flat(arg, ops)]


def _is_empty(node: Node) -> bool:
    return node.op == "$SetEnumerate" and not node.args
