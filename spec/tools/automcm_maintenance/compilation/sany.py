"""TLA+ modules as parsed by SANY: its XML, read into operators and expressions.

SANY is the parser of the TLA+ tools. ``export`` runs it to write its XML (half a second of Java);
``read`` converts the XML to ``ParsedModules``. Names are resolved, operators have their canonical
spelling, and every node has its location.
"""

from __future__ import annotations

import re
import subprocess
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

from automcm_spec.model_checking import tlc
from automcm_spec.model_checking.tlc import Location
from automcm_spec.support import scratch
from automcm_spec.support.paths import TLA

OTHER = "OTHER"
"""The op of the test of a CASE arm written as OTHER."""


_CONSTRUCTS = {
    "let": "LET within an expression",
    "$Case": "CASE within an expression",
    "$BoundedChoose": "CHOOSE",
    "$UnboundedChoose": "CHOOSE",
    "$FcnConstructor": "a function [x \\in S |-> e]",
    "$NonRecursiveFcnSpec": "a function f[x \\in S]",
    "$RecursiveFcnSpec": "a function f[x \\in S]",
    "$SetOfFcns": "a set of functions [S -> T]",
    "$SetOfRcds": "a set of records [a : S]",
    "'": "a primed expression",
    "OpArgNode": "an operator as argument",
}
"""TLA+ names for SANY's names of constructs."""


class NotCompiled(ValueError):
    """A construct that the compiler does not support; the text names it and its line."""

    def __init__(self, construct: str, at: Location) -> None:
        self.construct = _CONSTRUCTS.get(construct, construct)
        self.at = at
        super().__init__(f"{at.module}.tla:{at.line}: cannot be compiled: {self.construct}")


@dataclass(frozen=True)
class Node:
    """An expression. ``op`` is one of

    - ``number``, ``string``: a literal, in ``name``;
    - ``name``: a parameter, a bound name or a LET definition;
    - ``constant``: a CONSTANT;
    - ``call``: an operator of the specification, applied to ``args``;
    - ``let``: the definitions are ``bounds``, the body is ``args[0]``;
    - otherwise a TLA+ operator in SANY's spelling (``=``, ``$IfThenElse``, ``Cardinality``).

    The ``bounds`` of a quantifier or a set are the bound names and their ranges.
    """

    op: str
    at: Location
    name: str = ""
    args: tuple[Node, ...] = ()
    bounds: tuple[tuple[str, Node], ...] = ()

    def walk(self) -> Iterator[Node]:
        """The node and all nodes below it."""
        yield self
        for child in (*self.args, *(where for _, where in self.bounds)):
            yield from child.walk()

    def put(self, values: dict[str, Node]) -> Node:
        """The node with names replaced by expressions.  TLA+ has no shadowing."""
        if self.op == "name":
            return values.get(self.name, self)
        args = tuple(child.put(values) for child in self.args)
        bounds = tuple((name, where.put(values)) for name, where in self.bounds)
        return replace(self, args=args, bounds=bounds)


@dataclass(frozen=True)
class Operator:
    """A definition."""

    name: str
    params: tuple[str, ...]
    body: Node
    at: Location


@dataclass(frozen=True)
class ParsedModules:
    """The operators by name, in textual order, and the module of each constant."""

    operators: dict[str, Operator]
    constants: dict[str, str]


def export(module: str, tla: Path = TLA) -> bytes:
    """SANY's XML of a module in the folder and of all modules it extends.

    Raises tlc.TlcError if Java is missing or the module cannot be parsed.
    """
    java, jar = tlc.tools()
    command = [str(java), "-XX:TieredStopAtLevel=1", "-XX:+UseSerialGC", "-XX:-UsePerfData"]
    command += ["-Dfile.encoding=UTF-8", "-Duser.language=en", *tlc.quick_start()]
    program = ["-cp", str(jar), "tla2sany.xml.XMLExporter", "-o", f"{module}.tla"]
    try:
        # SANY unpacks the standard modules there, and removes them at the end.
        with scratch.folder("sany") as place:
            done = subprocess.run(
                [*command, f"-Djava.io.tmpdir={place}", *program],
                cwd=tla,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=120,
            )
    except OSError as error:
        raise tlc.TlcError("java", f"SANY could not be started: {error}") from error
    except subprocess.TimeoutExpired:
        raise tlc.TlcError("timeout", "SANY did not end within 120 s") from None
    # SANY writes its XML and exits with 0 despite many kinds of errors.
    failed = done.returncode or b"*** Errors:" in done.stderr
    if failed or not done.stdout.startswith(b"<?xml"):
        raise _complaint(module, (done.stderr or done.stdout).decode(errors="replace"))
    return done.stdout


_LINE = re.compile(r"line (\d+),? col(?:umn)? \d+.*?(?: of module (\w+))?$", re.MULTILINE)


def _complaint(module: str, text: str) -> tlc.TlcError:
    if "java.io.IOException" in text:  # a full disk; what follows is Java's trace
        text, _, _ = text.strip().partition("\n")
    message, _, _ = re.sub(r"Semantic processing.*\n", "", text).partition("failed for node")
    message = re.sub(r"\n\s*(at tla2sany.*)?", "\n", message).strip()
    where = _LINE.search(message)
    line = int(where[1]) if where else None
    return tlc.TlcError("parse", f"SANY: {message}", (where and where[2]) or module, line)


def read(xml: bytes) -> ParsedModules:
    """The operators of the modules in SANY's XML, except those of the standard modules.

    A construct that ``Node`` does not list becomes a node with SANY's name as ``op``; the compiler
    rejects it.
    """
    return _Reader(ElementTree.fromstring(xml)).specification()


STANDARD = {"Naturals", "Integers", "Sequences", "FiniteSets", "TLC", "Bags"}


class _Reader:
    def __init__(self, root: Element) -> None:
        self._known = {_text(entry, "UID"): entry[1] for entry in root.iterfind("context/entry")}
        # Extended modules come first.
        self._modules = [_name(self._of(ref)) for ref in root.iterfind("ModuleNodeRef")]

        self._inner = {
            _text(ref, "UID") for e in self._known.values() for ref in e.iterfind(".//opDefs/*")
        }

    def specification(self) -> ParsedModules:
        """All operators and constants, ordered by module and line."""
        operators, constants = [], []
        for uid, element in self._known.items():
            if element.tag == "OpDeclNode" and element.findtext("kind") == "2":
                constants.append((_place(element), _name(element)))
            elif self._is_ours(element) and uid not in self._inner:
                operators.append(self._operator(element))
        constants.sort(key=lambda pair: self._order(pair[0]))
        operators.sort(key=lambda operator: self._order(operator.at))
        return ParsedModules(
            {operator.name: operator for operator in operators},
            {name: at.module for at, name in constants},
        )

    def _is_ours(self, element: Element) -> bool:
        return element.tag == "UserDefinedOpKind" and _place(element).module not in STANDARD

    def _order(self, at: Location) -> tuple[int, int, int]:
        return self._modules.index(at.module), at.line, at.column

    def _of(self, ref: Element) -> Element:
        return self._known[_text(ref, "UID")]

    def _operator(self, element: Element) -> Operator:
        params = [self._of(ref) for ref in element.iterfind("params//FormalParamNodeRef")]
        at, body = _place(element), element.find("body")
        if element.find("recursive") is not None:
            node = Node("RECURSIVE", at)
        elif any(_text(param, "arity") != "0" for param in params):
            node = Node("an operator as parameter", at)
        else:
            node = Node("a definition without a body", at) if body is None else self._node(body[0])
        return Operator(_name(element), tuple(map(_name, params)), node, at)

    def _node(self, element: Element) -> Node:
        at = _place(element)
        match element.tag:
            case "NumeralNode":
                return Node("number", at, _text(element, "IntValue"))
            case "StringNode" if element.find("StringValue") is None:
                return Node(OTHER, at)
            case "StringNode":
                return Node("string", at, element.findtext("StringValue") or "")
            case "AtNode":
                return self._at(element, at)
            case "LetInNode":
                return self._let(element, at)
            case "OpApplNode":
                return self._application(element, at)
        return Node(element.tag, at)

    def _at(self, element: Element, at: Location) -> Node:
        """The expression that the ``@`` of an EXCEPT stands for."""
        *_, base, path = element
        node = self._node(base)
        for step in map(self._node, _child(path, "operands")):
            op = "$RcdSelect" if step.op == "string" else "$FcnApply"
            node = Node(op, at, "", (node, step))
        return node

    def _let(self, element: Element, at: Location) -> Node:
        bounds = []
        for ref in element.iterfind("opDefs/*"):
            operator = self._operator(self._of(ref))
            if operator.params:
                return Node("LET of an operator with parameters", operator.at)
            bounds.append((operator.name, operator.body))
        return Node("let", at, "", (self._node(_child(element, "body")[0]),), tuple(bounds))

    def _application(self, element: Element, at: Location) -> Node:
        ref = _child(element, "operator")[0]
        applied = self._of(ref)
        name = _name(applied)
        args = tuple(self._node(child) for child in _child(element, "operands"))
        bounds: list[tuple[str, Node]] = []
        for bound in element.iterfind("boundSymbols/*"):
            if bound.tag == "unbound":
                return Node("a bound name without a set", at)
            if bound.find("tuple") is not None:
                return Node("a tuple of bound names", at)
            *names, where = bound
            bounds += [(_name(self._of(ref)), self._node(where)) for ref in names]
        op = name
        if applied.tag == "FormalParamNode":
            op = "name"
        elif applied.tag == "OpDeclNode":
            op = "constant" if applied.findtext("kind") == "2" else "a variable"
        elif self._is_ours(applied):
            op = "name" if _text(ref, "UID") in self._inner else "call"
        return Node(op, at, name, args, tuple(bounds))


def _child(element: Element, tag: str) -> Element:
    found = element.find(tag)
    if found is None:
        raise ValueError(f"SANY's XML: {element.tag} without {tag}")
    return found


def _text(element: Element, tag: str) -> str:
    return _child(element, tag).text or ""


def _name(element: Element) -> str:
    return _text(element, "uniquename")


def _place(element: Element) -> Location:
    at = element.find("location")
    if at is None:
        return Location("", 0, 0, 0, 0)
    line, column = _child(at, "line"), _child(at, "column")
    return Location(
        _text(at, "filename"),
        *(int(_text(line, "begin")), int(_text(column, "begin"))),
        *(int(_text(line, "end")), int(_text(column, "end"))),
    )
