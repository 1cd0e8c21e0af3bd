"""What Station.tla does with the ids of stations and the numbers of sessions.

Ids may be compared for equality and counted. Session numbers may be compared for equality and
order, and increased by one. Then a behaviour remains one under every renaming of the stations, and
under every renumbering of sessions that keeps their order and successors; so a proof for some ids
and numbers holds for all (docs/verification.md, section 7).

The check infers types, like the compiler, on the syntax tree that the compiler reads. Ids, session
numbers and other integers (proposals, seq, limits) have different types there.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

from automcm_maintenance.compilation import compiler, sany
from automcm_maintenance.compilation.sany import Node, NotCompiled, Operator
from automcm_maintenance.compilation.tla_types import (
    BOOL,
    ID,
    INT,
    LITERAL,
    NUMBER,
    Alt,
    Env,
    Rec,
    SetOf,
    Tup,
    Type,
    Types,
)

SESSION = Tup((ID, NUMBER))
FIELDS: Mapping[str, Type] = {
    **dict.fromkeys(("src", "dst", "to", "target"), ID),
    **dict.fromkeys(("recorded", "withdrawn"), SetOf(ID)),
    "session": SESSION,
    **dict.fromkeys(("joined", "marks"), SetOf(SESSION)),
    "number": NUMBER,
    **dict.fromkeys(("proposal", "seq"), INT),
}
"""The fields of records that hold an integer."""
CONSTANTS: Mapping[str, Type] = {
    **compiler.PLAN.constants,
    "Peers": SetOf(ID),
    **dict.fromkeys(("OwnSessions", "PeerSessions"), SetOf(NUMBER)),
}
ROOTS = {
    "Initial": (),
    "Alphabet": (),
    "Step": ("id", "Initial", "*Alphabet"),
    "Marks": ("Initial",),
}
MODULE = compiler.PLAN.module
"""The module whose operators are examined."""
USES = ("compared", "ordered", "incremented", "counted")

_EQUAL = {"=", "/=", "\\in", "\\notin", "\\subseteq", "\\union", "\\intersect", "\\"}
_ORDER = {"<", ">", "\\leq", "\\geq"}


@dataclass
class _Kinds(Types):
    """Types that distinguish ids and session numbers.  ``uses``: who does what with which."""

    uses: defaultdict[tuple[Type, str], set[str]] = field(default_factory=lambda: defaultdict(set))

    def given(self, text: str) -> Type:
        """As ``Types.given``; also ``id``."""
        return ID if text == "id" else super().given(text)

    def _apply(self, operator: Operator, args: list[Type], call: Node | None = None) -> Type:
        found = super()._apply(operator, args, call)
        return ID if operator.name in compiler.PLAN.arguments else found

    def _record(self, node: Node, env: Env) -> Type:
        found = super()._record(node, env)
        assert isinstance(found, Rec)
        for name in found.classes:
            fields = self.classes[name].fields
            for each in fields.keys() & FIELDS.keys():
                fields[each] = self._join(fields[each], FIELDS[each], node)
        return found

    def of(self, node: Node, env: Env) -> Type:
        """The type of an expression. Raises NotCompiled where an id or a number is misused."""
        if node.op == "number" and self._is_open(node):
            return LITERAL
        if node.op in _ORDER or node.op in ("+", "-", ".."):
            return self._arithmetic(node, env)
        found = super().of(node, env)
        if node.op in _EQUAL:
            for arg in node.args:
                self._note(self.of(arg, env), "compared")
        if node.op == "Cardinality":
            self._note(self.of(node.args[0], env), "counted")
        return found

    def _is_open(self, node: Node) -> bool:
        """Whether a literal may be an id or a session number.

        In Station.tla, only 0 may (no station, no session); elsewhere it is an example.
        """
        return node.name == "0" or node.at.module != "Station"

    def _arithmetic(self, node: Node, env: Env) -> Type:
        first, second = (self.of(arg, env) for arg in node.args)
        is_successor = node.op == "+" and node.args[1].op == "number" and node.args[1].name == "1"
        if first == NUMBER and is_successor:
            self._note(NUMBER, "incremented")
            return NUMBER
        if first == second == NUMBER and node.op in _ORDER:
            self._note(NUMBER, "ordered")
            return BOOL
        for found in (first, second):
            if found not in (INT, LITERAL):
                names: Mapping[Type, str] = {ID: "an id", NUMBER: "a session number"}
                raise NotCompiled(f"{names.get(found, found)} in {node.op}", node.at)
        return SetOf(INT) if node.op == ".." else BOOL if node.op in _ORDER else INT

    def _note(self, found: Type, use: str) -> None:
        for kind in (ID, NUMBER):
            if _has(found, kind):
                self.uses[kind, use].add(self._inside)


def _has(found: Type, kind: Type) -> bool:
    match found:
        case SetOf(item):
            return _has(item, kind)
        case Tup(items):
            return any(_has(item, kind) for item in items)
        case Alt(forms):
            return any(_has(form, kind) for form in forms)
    return found == kind


def uses(xml: bytes) -> dict[tuple[str, str], list[str]]:
    """The operators of Station.tla by what they do ("ordered") with which kind ("id", "number").

    A comparison of records is not listed. ``xml`` is SANY's XML of OpenStation or of a module that
    extends it. Raises NotCompiled with the line where an id or a session number is used otherwise.
    """
    spec = sany.read(xml)
    kinds = _Kinds(spec, CONSTANTS, compiler.PLAN.classes)
    kinds.infer(ROOTS)
    ours = [name for name, one in spec.operators.items() if one.at.module == "Station"]
    return {
        (kind.name, use): [name for name in ours if name in kinds.uses[kind, use]]
        for kind in (ID, NUMBER)
        for use in USES
    }


def table() -> str:
    """The uses as a table of docs/verification.md.  Raises the exceptions of ``sany.export``."""
    found = uses(sany.export(MODULE))
    rows = ["| | " + " | ".join(USES) + " |", "|---" * 5 + "|"]
    for kind, title in (("id", "ids"), ("number", "session numbers")):
        cells = [title]
        for use in USES:
            names = found[kind, use]
            few = ", ".join(f"`{name}`" for name in names)
            cells.append(few if len(names) <= 2 else f"{len(names)} operators")
        rows.append("| " + " | ".join(cell or "none" for cell in cells) + " |")
    return "\n".join(rows)
