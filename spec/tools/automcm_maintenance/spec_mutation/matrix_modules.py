"""The TLA+ that explores many mutants of Station in one run of TLC.

A run of TLC costs seconds before it checks anything.  So the mutants of a batch are in one module:
a variable ``mut`` has the number of the mutant, each mutated operator asks it which of its versions
counts, and the state spaces of the mutants lie side by side.  The properties are constraints that
print what they find, because TLC stops at the first violation.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from automcm_maintenance.spec_mutation.mutants import Mutant
from automcm_spec.model_checking import models

MODULE = "Matrix"
"""The name of the module that checks a batch."""

ORIGINAL = 0
"""The number of the unmutated station."""

BESIDE = "StationOriginal"
"""The module with the unmutated station."""

ORACLE = "oracle"
"""What is printed if a mutant answers an input otherwise than the unmutated station."""

_ANSWERS = """
  LET mxInput == last'.input IN
  Step(Me, st, mxInput) = MxOriginal!Step(Me, st, mxInput)"""

_FIRST = 100
"""The first register of TLC that the modules of the specification do not use."""

_COMPARED = 100_000  # the first register of the mutants that differ

_HEAD = re.compile(rb"(\w+)(\([^)]*\))?\s*==")
_STEPS = re.compile(r"(.*?)/\\\s*\[\]\[(.+?)\]_(\w+|<<.*?>>)\s*(/\\.*)?", re.DOTALL)
_BOX = re.compile(r"(\s*)\[\]\[(.*)\]_(\w+|<<[^>]*>>)\s*", re.DOTALL)
_ALWAYS = re.compile(r"\s*\n( +)/\\ (?:.*\n\1/\\ )?\[\]\(([^()]*)\)\s*(?:\n\1/\\ .*)?", re.DOTALL)
_FIRST_CONJUNCT = re.compile(r"\s*(\w+)\s*/\\")
_OF_INSTANCE = re.compile(r"\s*(\w+)!(\w+)\s*")
_LINE = re.compile(r'"<<\\"MUTANT\\", (\d+), \\"(\w+)\\">>"')

LIMIT = "LIMIT"
"""What is printed in place of a property if a mutant has too many states."""

_DIFFERS = b"DIFFERS"
_TOKEN = re.compile(rb'"[^"]*"|\\\*[^\n]*|\(\*.*?\*\)|\w+', re.DOTALL)


class Unsupported(ValueError):
    """A model whose specification or property has a form that cannot be checked in a batch."""


@dataclass(frozen=True)
class Checks:
    """What a model explores and checks, as TLA+.

    rest is its cfg without specification, view and checks.  view lists what distinguishes two
    states.  steps are the bodies of action properties by name, with the text of the definition from
    which they come; entries are what must hold at the start.  parts are the safety of temporal
    properties: what must hold at the start, and at each step.
    """

    module: str
    rest: str
    init: str
    next: str
    variables: str
    fairness: str
    view: str
    compared: bool
    invariants: tuple[str, ...]
    steps: Mapping[str, str]
    entries: Mapping[str, str]
    temporal: tuple[str, ...]
    parts: Mapping[str, tuple[str, str]]

    @property
    def names(self) -> tuple[str, ...]:
        """The TLA+ names of what is checked."""
        return (*self.invariants, *self.steps, *self.temporal)


def checks(module: str, cfg: str, texts: Mapping[str, str], *, compared: bool = False) -> Checks:
    """Read a cfg and the modules.  Raises Unsupported.

    ``compared``, only for StationProperties, adds the comparison with the unmutated station.
    """
    rest, listed = models.split(cfg)
    read = models.extended(module, texts)
    whole = "\n".join(texts[name] for name in sorted(read))
    rest, specification = _taken(rest, "SPECIFICATION")
    rest, view = _taken(rest, "VIEW")
    if specification is None:
        raise Unsupported("the cfg must name a SPECIFICATION")
    formula = _STEPS.fullmatch(" ".join(_definition(whole, specification).split()))
    if formula is None:
        raise Unsupported(f"{specification} is not Init /\\ [][Next]_vars")
    init, next_, variables, fairness = formula.groups()
    steps: dict[str, str] = {}
    entries: dict[str, str] = {}
    temporal: list[str] = []
    parts: dict[str, tuple[str, str]] = {}
    for word, name in listed:
        if not word.startswith("PROPERT"):
            continue
        body = _definition(whole, name)
        if box := _BOX.fullmatch(body):
            blanks, action, unchanged = box.groups()
            steps[name] = f"{blanks}  ({action})\n  \\/ UNCHANGED {unchanged}"
        elif (instance := _safety(body, whole, texts)) is not None:
            entries[name], steps[name] = instance
        else:
            temporal.append(name)
            if (part := _part(body, whole, texts)) is not None:
                parts[name] = part
    if compared:
        steps[ORACLE] = _ANSWERS
    invariants = tuple(name for word, name in listed if word.startswith("INVARIANT"))
    if temporal and (steps or invariants):
        raise Unsupported("temporal properties are checked apart from the others")
    return Checks(
        module, rest, init.strip(), next_, variables, fairness or "", view or variables,
        compared, invariants, steps, entries, tuple(temporal), parts,
    )  # fmt: skip


def _taken(rest: str, keyword: str) -> tuple[str, str | None]:
    found = re.search(rf"^{keyword}\s+(\w+)\s*$", rest, re.MULTILINE)
    if found is None:
        return rest, None
    return rest[: found.start()] + rest[found.end() :], found[1]


def _definition(text: str, name: str) -> str:
    """The text after ``name ==`` up to the next line that is not indented, without comments."""
    found = re.search(rf"^{name}\s*==(.*?)(?=^\S|\Z)", text, re.MULTILINE | re.DOTALL)
    if found is None:
        raise Unsupported(f"no module defines {name}")
    return re.sub(r"\\\*[^\n]*", "", found[1])


def _instance(body: str, whole: str, texts: Mapping[str, str]) -> tuple[str, str] | None:
    """Of ``Instance!Name`` the instance, and the definition of Name.  Raises Unsupported."""
    if (found := _OF_INSTANCE.fullmatch(body)) is None:
        return None
    instance, name = found.groups()
    of = re.search(rf"^{instance}\s*==\s*INSTANCE\s+(\w+)", whole, re.MULTILINE)
    if of is None or of[1] not in texts:
        raise Unsupported(f"no module defines the instance {instance}")
    return instance, _definition(texts[of[1]], name)


def _safety(body: str, whole: str, texts: Mapping[str, str]) -> tuple[str, str] | None:
    """Of ``Instance!Safe``, where Safe is Init /\\ [][Next]_vars: the start, and the step."""
    if (found := _instance(body, whole, texts)) is None:
        return None
    instance, definition = found
    parts = _STEPS.fullmatch(" ".join(definition.split()))
    if parts is None or parts[4]:
        return None
    start, next_, variables = (f"{instance}!{part.strip()}" for part in parts.groups()[:3])
    return start, f" {next_} \\/ {variables}' = {variables}"


def _part(body: str, whole: str, texts: Mapping[str, str]) -> tuple[str, str] | None:
    """The safety of a temporal property: of ``Instance!Spec``, where Spec is Safe /\\ ..., that of
    ``Instance!Safe``; of a list of conjuncts ``[](P)``."""
    if (found := _instance(body, whole, texts)) is not None:
        instance, definition = found
        first = _FIRST_CONJUNCT.match(definition)
        return None if first is None else _safety(f"{instance}!{first[1]}", whole, texts)
    always = _ALWAYS.fullmatch(body)
    return None if always is None else (always[2], f"  ({always[2]})'")


def station(
    source: bytes, spans: Mapping[str, tuple[int, int]], batch: Mapping[int, Mutant]
) -> bytes:
    """Station with all mutants of a batch, by number; spans are the bytes of its definitions.

    An operator has the value of the mutant ``mut``.
    """

    def dispatched(definition: _Definition, mutants: Mapping[int, Mutant]) -> bytes:
        if not mutants:
            return definition.text
        arms = [
            b"mut = %d -> %s" % (n, definition.call(definition.name + b"_m%d" % n)) for n in mutants
        ]
        arms.append(b"OTHER -> " + definition.call(definition.name + b"_m0"))
        versions = [definition.renamed(definition.name + b"_m0", definition.text)]
        versions += [
            definition.renamed(definition.name + b"_m%d" % n, definition.mutated(m))
            for n, m in mutants.items()
        ]
        value = definition.call(definition.name) + b" ==\n  CASE " + b"\n    [] ".join(arms)
        return b"".join([*versions, value, b"\n"])

    return _rewritten(source, spans, batch, b"VARIABLE mut\n", dispatched)


def compared(
    source: bytes, spans: Mapping[str, tuple[int, int]], batch: Mapping[int, Mutant]
) -> bytes:
    """Station, unmutated, that prints the number of each mutant of which an operator has another
    value wherever this one is evaluated.

    The versions of the mutants call copies of the operators, which compare nothing.  The name of a
    copy has the cases swapped, and so its length, because lists of conjuncts depend on columns.
    """

    def copy(text: bytes) -> bytes:
        return _TOKEN.sub(
            lambda found: found[0].swapcase() if found[0].decode() in spans else found[0], text
        )

    def comparing(definition: _Definition, mutants: Mapping[int, Mutant]) -> bytes:
        plain = copy(definition.text) + b"\n"
        if not mutants:
            return plain + definition.text
        name = definition.name.swapcase()
        same = [
            b"(TLCGet(%d) = 1 \\/ %s = mxValue \\/ "
            b'(TLCSet(%d, 1) /\\ PrintT(ToString(<<"MUTANT", %d, "%s">>))))'
            % (_COMPARED + n, definition.call(name + b"_m%d" % n), _COMPARED + n, n, _DIFFERS)
            for n in mutants
        ]
        versions = [definition.renamed(definition.name + b"_m0", definition.text)]
        versions += [
            definition.renamed(name + b"_m%d" % n, copy(definition.mutated(m)))
            for n, m in mutants.items()
        ]
        value = (
            definition.call(definition.name)
            + b" ==\n  LET mxValue == "
            + definition.call(definition.name + b"_m0")
            + b" IN\n  IF /\\ "
            + b"\n     /\\ ".join(same)
            + b"\n  THEN mxValue ELSE mxValue\n"
        )
        return b"".join([plain, *versions, value])

    more = b"LOCAL INSTANCE TLC\nVARIABLE mut\nASSUME \\A m \\in {%s} : TLCSet(%d + m, 0)\n" % (
        b", ".join(b"%d" % number for number in batch),
        _COMPARED,
    )
    return _rewritten(source, spans, batch, more, comparing)


@dataclass(frozen=True)
class _Definition:
    """A definition of Station: its bytes in the module, its name, its parameters in parentheses."""

    source: bytes
    start: int
    end: int
    name: bytes
    parameters: bytes
    head: int

    @property
    def text(self) -> bytes:
        return self.source[self.start : self.end]

    def mutated(self, mutant: Mutant) -> bytes:
        """Its text in a mutant."""
        longer = len(mutant.replacement) - (mutant.end - mutant.start)
        return mutant.apply(self.source)[self.start : self.end + longer]

    def call(self, name: bytes) -> bytes:
        """A call with its own parameters, or the head of a definition."""
        return name + self.parameters

    def renamed(self, name: bytes, text: bytes) -> bytes:
        """A text of it under another name; the columns of what follows the name stay."""
        return self.call(name) + b" ==\n" + b" " * self.head + text[self.head :] + b"\n"


def _rewritten(
    source: bytes,
    spans: Mapping[str, tuple[int, int]],
    batch: Mapping[int, Mutant],
    more: bytes,
    rewrite: Callable[[_Definition, Mapping[int, Mutant]], bytes],
) -> bytes:
    """Station with each definition rewritten, and more after what it extends.

    The assumption on its constants becomes TRUE, because TLC refuses one that depends on a
    variable.  (The models check it.)
    """
    pieces: list[bytes] = []
    position = 0
    for name, (start, end) in sorted(spans.items(), key=lambda item: item[1]):
        head = _HEAD.match(source, start)
        if head is None or source[start - 1 : start] != b"\n":
            raise Unsupported(f"the definition of {name} must begin a line")
        if name == "LimitsSuffice":
            new = b"LimitsSuffice == TRUE\n"
        else:
            definition = _Definition(
                source, start, end, head[1], head[2] or b"", head.end() - start
            )
            mutants = {n: mutant for n, mutant in batch.items() if mutant.operator == name}
            new = rewrite(definition, mutants)
        pieces += [source[position:start], new]
        position = end
    text = b"".join([*pieces, source[position:]])
    text, count = re.subn(rb"(?m)^EXTENDS [^\n]*\n", lambda found: found[0] + more, text, count=1)
    if count != 1:
        raise Unsupported("Station must extend the standard modules")
    return text


def matrix(
    what: Checks, numbers: Sequence[int], known: Mapping[int, Collection[str]], limit: int
) -> tuple[str, str]:
    """The module and the cfg that check the mutants of these numbers.

    known are the properties of a mutant that need not be checked.  A mutant with none left, or with
    ``limit`` states, is explored no further.
    """
    column = {name: n for n, name in enumerate(what.names)}
    width = len(column) + 2  # after the properties: how many are left, and the number of states
    left, count = len(column), len(column) + 1
    settled = {(n, column[name]) for n in numbers for name in known.get(n, ()) if name in column}
    lines = [
        f"---- MODULE {MODULE} ----",
        f"EXTENDS {what.module}, TLC",
        f"MxAt(m, j) == {_FIRST} + m * {width} + j",
        f"MxMutants == {_set(numbers)}",
        f"MxSettled == {_set(f'<<{n}, {j}>>' for n, j in sorted(settled))}",
        "ASSUME \\A m \\in MxMutants :",
        f"  /\\ \\A j \\in 0 .. {len(column) - 1} :",
        "       TLCSet(MxAt(m, j), IF <<m, j>> \\in MxSettled THEN 1 ELSE 0)",
        f"  /\\ TLCSet(MxAt(m, {left}), Cardinality({{j \\in 0 .. {len(column) - 1} :",
        "                                          <<m, j>> \\notin MxSettled}))",
        f"  /\\ TLCSet(MxAt(m, {count}), 0)",
        'MxSay(text) == PrintT(ToString(<<"MUTANT", mut, text>>))',
        "MxKnown(j) == TLCGet(MxAt(mut, j)) = 1",
        "MxKill(j, name) ==",
        "  /\\ TLCSet(MxAt(mut, j), 1)",
        f"  /\\ TLCSet(MxAt(mut, {left}), TLCGet(MxAt(mut, {left})) - 1)",
        "  /\\ MxSay(name)",
        f"MxGoes == TLCGet(MxAt(mut, {left})) > 0 /\\ TLCGet(MxAt(mut, {count})) < {limit}",
        "MxCounted ==",
        f"  /\\ TLCSet(MxAt(mut, {count}), TLCGet(MxAt(mut, {count})) + 1)",
        f'  /\\ TLCGet(MxAt(mut, {count})) = {limit} => MxSay("{LIMIT}")',
    ]

    def judged(name: str, condition: str) -> str:
        return f'  /\\ MxKnown({column[name]}) \\/ {condition} \\/ MxKill({column[name]}, "{name}")'

    if what.compared:
        lines.append(f"MxOriginal == INSTANCE {BESIDE}")
    for name, body in what.steps.items():
        lines += [f"MxStep_{name} =={body}"]
    lines += ["MxStates ==", "  /\\ MxCounted", *(judged(name, name) for name in what.invariants)]
    lines += ["MxSteps ==", "  /\\ TRUE", *(judged(name, f"MxStep_{name}") for name in what.steps)]
    lines += ["MxInit ==", "  /\\ mut \\in MxMutants", f"  /\\ ({what.init})"]
    lines += [judged(name, text) for name, text in what.entries.items()]
    lines += ["MxNext ==", "  /\\ mut' = mut", f"  /\\ ({what.next})"]
    lines += [f"MxView == <<mut, {what.view}>>"]
    lines += [f"MxSpec == MxInit /\\ [][MxNext]_<<mut, {what.variables}>> {what.fairness}"]
    lines += ["====", ""]
    cfg = [what.rest, "VIEW MxView", "INVARIANT MxStates", "CONSTRAINT MxGoes"]
    if what.temporal:
        cfg += ["SPECIFICATION MxSpec", f"PROPERTIES {' '.join(what.temporal)}"]
    else:
        cfg += ["INIT MxInit", "NEXT MxNext", "ACTION_CONSTRAINT MxSteps"]
    return "\n".join(lines), "\n".join([*cfg, ""])


def _set(members: Iterable[object]) -> str:
    return "{" + ", ".join(map(str, members)) + "}"


def beside(source: bytes) -> bytes:
    """The unmutated station as the module BESIDE."""
    return source.replace(b"MODULE Station ", b"MODULE " + BESIDE.encode() + b" ", 1)


def version_at(text: bytes, line: int) -> int | None:
    """The mutant whose version of an operator has this line of a generated Station."""
    for above in reversed(text.split(b"\n")[:line]):
        if found := re.match(rb"\w+_m(\d+)(?:\([^)]*\))? ==$", above):
            return int(found[1])
        if re.match(rb"\w+(?:\([^)]*\))?\s*==", above):
            return None
    return None


def printed(line: str) -> tuple[int, str] | None:
    """The mutant and the property (or LIMIT) of a line that TLC printed."""
    found = _LINE.fullmatch(line.strip())
    return None if found is None else (int(found[1]), found[2])
