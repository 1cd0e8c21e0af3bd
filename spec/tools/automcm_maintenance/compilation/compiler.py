"""Compiles Station.tla and OpenStation.tla to automcm_spec/vocabulary/station.py, which needs no
Java.

docs/oracle.md describes the supported subset of TLA+. Anything else is rejected with its name and
line. ``source`` compiles any module, for tests.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from automcm_maintenance.compilation import sany
from automcm_maintenance.compilation.sany import Operator, ParsedModules
from automcm_maintenance.compilation.tla_types import (
    INT,
    TAG,
    Alt,
    Basic,
    IncomparableTypes,
    Rec,
    SetOf,
    Str,
    Tup,
    Type,
    Types,
    join,
)
from automcm_maintenance.compilation.translation import Translator
from automcm_spec.model_checking.toolchain import ToolError
from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary import tla_names
from automcm_spec.vocabulary.tla_names import local, snake

PATH = Path(tla_names.__file__).with_name("station.py")


@dataclass(frozen=True)
class CompilerPlan:
    """What to compile from a module, and the Python names."""

    module: str
    roots: Mapping[str, Sequence[str]]
    """The operators to compile, with the types of their parameters: see ``Types.given``."""
    constants: Mapping[str, Type] = field(default_factory=dict)
    classes: Mapping[str, str] = field(default_factory=dict)
    """The class of the records that an operator makes, if it differs from the operator's name."""
    aliases: Mapping[str, str] = field(default_factory=dict)
    """Names for types: see ``Types.given``."""
    decides: str = ""
    """An operator. In operators with the same type of value, the conditions of IF are guards."""
    arguments: Sequence[str] = ()
    """Operators without parameters that become constructor arguments, with their value as
    default."""


PLAN = CompilerPlan(
    "OpenStation",
    roots={
        "Initial": (),
        "Alphabet": (),
        "Step": ("int", "Initial", "*Alphabet"),
        "Marks": ("Initial",),
        "StationTypeInv": ("int", "Initial"),
        "Offered": ("Initial", "*Alphabet"),
    },
    constants={
        **dict.fromkeys(("MaxRounds", "MaxParticipants", "OutboxLimit", "MemoryLimit"), INT),
        **dict.fromkeys(("Peers", "OwnSessions", "PeerSessions"), SetOf(INT)),
    },
    classes={"Initial": "State", "Step": "Outcome"},
    aliases={"Session": "NoSession", "Timer": "*Timers", "Input": "*Alphabet"},
    decides="Decide",
    arguments=("Me", "Stranger"),
)


def text(tla: Path = TLA, xml: bytes | None = None) -> str:
    """The required contents of automcm_spec/vocabulary/station.py.

    ``xml`` is SANY's XML of OpenStation, if available. Raises tlc.TlcError if SANY cannot parse the
    module, sany.NotCompiled for an unsupported construct, ToolError if ruff fails.
    """
    return formatted(source(PLAN, xml or sany.export(PLAN.module, tla), tla))


def is_fresh() -> bool:
    """Whether the committed module is the present output of the compiler.

    Raises the exceptions of ``text``.
    """
    return PATH.exists() and PATH.read_text(encoding="utf-8") == text()


def source(plan: CompilerPlan, xml: bytes, tla: Path) -> str:
    """The Python module, unformatted."""
    return _Writer(plan, sany.read(xml), tla).module()


def formatted(code: str) -> str:
    """The module formatted by ruff, without unused imports."""
    for command in (["check", "--select", "F401,UP034", "--fix", "--quiet"], ["format"]):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *command, "--isolated", "--line-length", "100", "-"],
            input=code,
            capture_output=True,
            text=True,
        )
        if done.returncode:
            raise ToolError(f"ruff: {done.stderr.strip() or done.stdout.strip()}")
        code = done.stdout
    return code


HEAD = '''"""{modules} as Python.  Generated: do not edit, run make generate.

Each method is the operator of that name, each class of records a NamedTuple.  Sets are frozensets;
tuples are tuples, whose elements count from 0 here (automcm_maintenance.compilation.compiler).
"""

# The compiler knows which form of tuple is left where an element is read; mypy does not.
# mypy: disable-error-code="arg-type, misc"

from __future__ import annotations

from functools import cached_property
from itertools import chain, product
from typing import Any, Literal, NamedTuple, Never, TypeAlias

from automcm_spec.vocabulary.conditions import EMPTY, Condition, NoArm

'''


class _Writer:
    def __init__(self, plan: CompilerPlan, spec: ParsedModules, tla: Path) -> None:
        self.plan = plan
        self.spec = spec
        self.types = Types(spec, plan.constants, plan.classes)
        self.types.infer(plan.roots)
        self.modules = list(dict.fromkeys(o.at.module for o in self._operators()))
        lines = {
            m: (tla / f"{m}.tla").read_text(encoding="utf-8").splitlines() for m in self.modules
        }
        decides = self.types.signatures.get(plan.decides)
        self.translator = Translator(self.types, lines, decides.result if decides else None)
        self.aliases = {name: self.types.given(of) for name, of in plan.aliases.items()}

    def _operators(self) -> list[Operator]:
        return [o for o in self.spec.operators.values() if o.name in self.types.signatures]

    def module(self) -> str:
        """The complete module."""
        parts = [HEAD.format(modules=" and ".join(f"{m}.tla" for m in self.modules))]
        parts += [self._class_of_records(name) for name in self.types.classes]
        for name, found in self.aliases.items():
            parts.append(f"{name}: TypeAlias = {self.python(found, alias=False)}\n")
        parts += [self._class(n, module) for n, module in enumerate(self.modules)]
        rows = "".join(f"    Condition{tuple(row)!r},\n" for row in self.translator.rows)
        parts.append(f"CONDITIONS = (\n{rows})\n")
        parts.append('"""What is decided where: see automcm_spec.vocabulary.conditions."""\n')
        return "\n\n".join(parts)

    def python(self, t: Type, alias: bool = True) -> str:
        """The annotation of a type."""
        for name, known in self.aliases.items() if alias else ():
            if known == t or (isinstance(known, Alt) and _is_part(t, known)):
                return name
        match t:
            case Basic(name):
                return name
            case Str():
                return "str"
            case SetOf(item):
                return f"frozenset[{self.python(item)}]"
            case Tup(items):
                return f"tuple[{', '.join(map(self.python, items)) or '()'}]"
            case Alt(forms):
                if all(isinstance(item, Str) for form in forms for item in form.items):
                    return "tuple[str, ...]"
                return " | ".join(sorted(self.python(form, alias=False) for form in forms))
            case Rec(classes):
                return " | ".join(sorted(classes))

    def _class_of_records(self, name: str) -> str:
        made = self.types.classes[name]
        where = f"{made.at.module}.tla:{made.at.line}"
        lines = [f'class {name}(NamedTuple):\n    """{where}."""\n']
        for n, (one, t) in enumerate(made.fields.items()):
            if one == TAG and n == 0 and isinstance(t, Str) and len(t.literals) == 1:
                lines.append(f"    {local(one)}: Literal[{next(iter(t.literals))!r}]")
            else:
                lines.append(f"    {local(one)}: {self.python(t)}")
        return "\n".join(lines)

    def _class(self, n: int, module: str) -> str:
        lines = [f"class {module}({self.modules[n - 1]}):" if n else f"class {module}:"]
        lines += [f'    """The operators of {module}.tla with these constants."""\n']
        lines.append(self._init(n, module))
        for operator in self._operators():
            if operator.at.module == module and operator.name not in self.plan.arguments:
                lines.append("\n".join("    " + s for s in self._method(operator).splitlines()))
        return "\n\n".join(lines)

    def _init(self, n: int, module: str) -> str:
        def arguments(modules: Sequence[str]) -> dict[str, str]:
            constants = [c for c, m in self.spec.constants.items() if m in modules]
            found = {snake(c): self.python(self.plan.constants[c]) for c in constants}
            for name in self.plan.arguments:
                operator = self.spec.operators[name]
                if operator.at.module in modules:
                    t = self.python(self.types.signatures[name].result)
                    found[snake(name)] = f"{t} = {operator.body.name}"
            return found

        own, given = arguments([module]), arguments(self.modules[:n])
        all_ = [f"{name}: {t}" for name, t in arguments(self.modules[: n + 1]).items()]
        body = [f"super().__init__({', '.join(given)})"] if n else []
        body += [f"self.{name} = {name}" for name in own] or ([] if n else ["pass"])
        return "\n        ".join(
            [f"    def __init__({', '.join(['self', *all_])}) -> None:", *body]
        )

    def _method(self, operator: Operator) -> str:
        signature = self.types.signatures[operator.name]
        both = zip(operator.params, signature.params, strict=True)
        params = ["self", *(f"{local(name)}: {self.python(t)}" for name, t in both)]
        result = self.python(signature.result)
        head = f"def {snake(operator.name)}({', '.join(params)}) -> {result}:"
        if not operator.params:
            head = f"@cached_property\n{head}"
        return ast.unparse(self.translator.method(operator, head))


def _is_part(t: Type, whole: Type) -> bool:
    try:
        return join(whole, t) == whole and t != Basic("Never")
    except IncomparableTypes:
        return False
