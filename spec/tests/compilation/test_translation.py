"""Each construct of the subset against TLC's own value of the same expression, and what is refused.

One TLA+ module holds all expressions, TLC prints their values in one run, and nothing that is
expected is typed here.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from automcm_maintenance.compilation import compiler, sany
from automcm_maintenance.compilation.tla_types import INT, SetOf
from automcm_spec.model_checking import tla_values, tlc
from automcm_spec.vocabulary.conditions import NoArm
from automcm_spec.vocabulary.tla_names import snake

Load = Callable[[str], ModuleType]

HELPERS = r"""
Pair(a, b)       == <<a, b>>
First(a, b)      == a
Choice(c, a, b)  == IF c THEN a ELSE b
Box(a)           == [kind |-> "box", item |-> a]
Bag(a)           == [kind |-> "bag", items |-> a]
Inside(r)        == CASE r.kind = "box" -> {r.item} [] r.kind = "bag" -> r.items
Timer(n)         == <<n>>
Late(n, k)       == <<"late", k>>
Delay(t)         == CASE t[1] = "late" -> t[2] [] OTHER -> 0
Is(l, in)        == l = in
Inner            == [one |-> 1, two |-> {1}]
Deep             == [name |-> "deep", inner |-> Inner, last |-> 3]
Nothing          == CASE FALSE -> 1
"""

CONSTRUCTS = {
    "number": "12",
    "string": '"a b"',
    "TRUE FALSE": "<<TRUE, FALSE>>",
    "BOOLEAN": "BOOLEAN",
    "CONSTANT": "<<Limit, Some>>",
    "+": "2 + Limit",
    "-": "Limit - 2",
    "<": "{<<a, b>> : a \\in {b \\in 1 .. 3 : b < 2}, b \\in {1}}",
    "< > <= >=": "{<<n, n < 2, n > 2, n <= 2, n >= 2>> : n \\in 1 .. 3}",
    "..": "<<2 .. 4, 3 .. 3, 3 .. 2>>",
    "= of numbers": "<<1 = 1, 1 = 2>>",
    "= of strings": '<<"a" = "a", "a" = "b">>',
    "= of truth values": "<<TRUE = FALSE, (1 = 1) = (2 = 2)>>",
    "= of sets": "<<{1, 2} = {2, 1, 1}, {1} = {}, {} = {}, Some = {}>>",
    "= of tuples": "<<<<1, 2>> = <<1, 2>>, <<1, 2>> = <<2, 1>>, <<>> = <<>>>>",
    "= of tuples of different length": "<<<<1>> = <<1, 2>>, <<>> = <<1>>>>",
    "= of records": "<<Box(1) = Box(1), Box(1) = Box(2)>>",
    "#": '<<1 # 2, "a" # "a", {1} # {}, {} # {}, <<1>> # <<1>>>>',
    "/\\": "{<<a, b, a /\\ b>> : a \\in BOOLEAN, b \\in BOOLEAN}",
    "\\/": "{<<a, b, a \\/ b>> : a \\in BOOLEAN, b \\in BOOLEAN}",
    "=>": "{<<a, b, a => b>> : a \\in BOOLEAN, b \\in BOOLEAN}",
    "~": "<<~TRUE, ~(1 = 1), ~(1 \\in {2}), ~(1 < 2 /\\ 2 < 1)>>",
    "lists of /\\ and \\/": "/\\ 1 = 1\n  /\\ \\/ 1 = 2\n     \\/ 2 = 2",
    "a list of three": "{n \\in 1 .. 9 :\n    /\\ n > 2\n    /\\ n < 8\n    /\\ n # 5}",
    "a list in a set": "{n \\in 1 .. 9 :\n    \\/ /\\ n > 2\n       /\\ n < 5\n    \\/ n = 7}",
    "/\\ stops at FALSE": "FALSE /\\ Nothing = 1",
    "\\/ stops at TRUE": "TRUE \\/ Nothing = 1",
    "=> stops at FALSE": "FALSE => Nothing = 1",
    "\\in": "<<1 \\in {1, 2}, 3 \\in {1, 2}, 1 \\in {}, 2 \\in Some>>",
    "\\in a range": "<<2 \\in 1 .. 3, 4 \\in 1 .. 3>>",
    "\\in a set of sets": "<<{1} \\in {{1}, {2}}, {} \\in {{1}, {}}>>",
    "\\notin": "<<1 \\notin {1, 2}, 3 \\notin 1 .. 2>>",
    "\\subseteq": "<<{1} \\subseteq {1, 2}, {1, 2} \\subseteq {1, 2}, {3} \\subseteq {1}>>",
    "\\cup": "{1, 2} \\cup {2, 3} \\cup {}",
    "\\cap": "<<{1, 2} \\cap {2, 3}, {1} \\cap {2}>>",
    "\\": "<<{1, 2, 3} \\ {2}, {1} \\ {1}>>",
    "UNION of a list": "UNION {{1}, {2, 3}, {}}",
    "UNION of a set": "<<UNION {1 .. n : n \\in Some}, UNION {s \\in {{1}, {2}} : 1 \\in s}>>",
    "UNION of nothing": "UNION {}",
    "\\X": '<<{1, 2} \\X {"a"}, {1} \\X {2} \\X {3, 4}>>',
    "{a, b}": "<<{}, {1}, {1, 1, 2}, {{}, {1}}>>",
    "{e : x \\in S}": "{n + n : n \\in 1 .. 3}",
    "{e : x \\in S, y \\in T}": "{<<a, b>> : a \\in 1 .. 2, b \\in {5, 6}}",
    "{e : x, y \\in S}": "{<<a, b>> : a, b \\in 1 .. 2}",
    "{x \\in S : p}": "{n \\in 1 .. 5 : n > 2 /\\ n # 4}",
    "\\E": "<<\\E n \\in Some : n = 2, \\E n \\in Some : n = 9, \\E n \\in {} : TRUE>>",
    "\\E of two names": "\\E a, b \\in 1 .. 3, c \\in {6} : a + b = c",
    "\\A": "<<\\A n \\in 1 .. 3 : n < 4, \\A n \\in 1 .. 3 : n < 3, \\A n \\in {} : FALSE>>",
    "<<a, b>>": '<<1, "a", {2}, <<>>, <<3>>>>',
    "t[1]": "<<Pair(7, 8)[1], Pair(7, 8)[2]>>",
    "[a |-> 1]": "<<Deep, [src |-> 1, dst |-> 2]>>",
    "r.a": "<<Deep.name, Deep.inner.two>>",
    "records in one set": "{Box(1), Bag({1}), Box(2)}",
    "CASE tells records apart": "<<Inside(Box(1)), Inside(Bag({2, 3}))>>",
    "tuples of different forms in one set": '{Timer("a"), Late("b", 2), Timer("b")}',
    "CASE tells tuples apart": '{Delay(t) : t \\in {Timer("a"), Late("b", 2)}}',
    "EXCEPT": '[Deep EXCEPT !.name = "x"]',
    "EXCEPT of two fields": '[Deep EXCEPT !.last = 4, !.name = "y"]',
    "EXCEPT in EXCEPT with @": "[Deep EXCEPT !.inner = [@ EXCEPT !.one = @ + 5]]",
    "EXCEPT with @": "[Deep EXCEPT !.last = @ + 1]",
    "EXCEPT of a call": "[Box(1) EXCEPT !.item = @ + 1]",
    "IF": "<<IF 1 = 1 THEN 1 ELSE 2, IF 1 = 2 THEN 1 ELSE 2>>",
    "IF does not need the other branch": "IF TRUE THEN 1 ELSE Nothing",
    "CASE takes the first arm": "CASE FALSE -> 1 [] TRUE -> 2 [] TRUE -> 3",
    "LET": "LET a == 2 IN a + a",
    "LET of two": "LET a == 2  b == a + 1 IN <<b, a>>",
    "LET that is not needed": "LET a == Nothing IN IF TRUE THEN 1 ELSE a",
    "LET that one branch needs": "LET a == Limit + 1 IN IF Limit = 3 THEN a ELSE 0",
    "LET needed after a test": "LET a == Nothing IN IF TRUE \\/ a = 1 THEN 5 ELSE a",
    "LET that a LET does not need": "LET a == Nothing  b == IF TRUE THEN 1 ELSE a IN b",
    "LET that only a set needs": "LET a == Nothing IN {a + n : n \\in {}}",
    "LET in CASE": "LET a == 1  b == Nothing IN CASE a = 2 -> b [] a = 1 -> 4",
    "an operator": "Pair(1, Choice(TRUE, 2, 3))",
    "an operator does not need its argument": "<<First(1, Nothing), Choice(FALSE, Nothing, 2)>>",
    "Cardinality": "<<Cardinality({}), Cardinality({1, 1, 2}), Cardinality(Some)>>",
    "names that Python has": "<<Is(1, 1), Is(1, 2)>>",
    "{} is in a set": "{s \\in {{}, {1}} : s # {}}",
}


def _module(name: str, definitions: str) -> str:
    return (
        f"---- MODULE {name} ----\nEXTENDS Naturals, FiniteSets, Sequences, TLC\n"
        f"CONSTANTS Limit, Some\nVARIABLE x\n{definitions}\n"
    )


def shown(value: Any) -> str:
    """A text that tells TRUE from 1, and is equal for equal values."""
    return json.dumps(value, sort_keys=True, default=lambda several: sorted(several, key=shown))


def _tla(value: Any) -> tla_values.Value:
    """A value of a compiled module as values.parse gives it."""
    if hasattr(value, "_asdict"):
        fields = value._asdict().items()
        return tla_values.Record({name.rstrip("_"): _tla(item) for name, item in fields})
    if isinstance(value, tuple | frozenset):
        return type(value)(map(_tla, value))
    return value  # type: ignore[no-any-return]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("constructs")
    lines = [f"E{n} ==\n  {text}" for n, text in enumerate(CONSTRUCTS.values())]
    printed = " /\\ ".join(f"PrintT(ToString(<<{n}, E{n}>>))" for n in range(len(CONSTRUCTS)))
    text = HELPERS + "\n".join(lines) + f"\nInit == x = 0 /\\ {printed}\nNext == x' = x\n===="
    (path / "Constructs.tla").write_text(_module("Constructs", text))
    (path / "Constructs.cfg").write_text(
        "CONSTANTS\n  Limit = 3\n  Some = {2, 3}\nINIT Init\nNEXT Next\n"
    )
    return path


@pytest.fixture(scope="module")
def of_tlc(folder: Path) -> dict[int, str]:
    printed: dict[int, str] = {}

    def line(text: str) -> None:
        value = tla_values.parse(text[1:-1].replace('\\"', '"'))
        assert isinstance(value, tuple) and isinstance(value[0], int)
        printed[value[0]] = shown(value[1])

    cfg = folder / "Constructs.cfg"
    tlc.run("Constructs", cfg, tla_dir=folder, on_print=line, short=True)
    return printed


PLAN = compiler.CompilerPlan(
    "Constructs",
    roots={f"E{n}": () for n in range(len(CONSTRUCTS))} | {"Nothing": ()},
    constants={"Limit": INT, "Some": SetOf(INT)},
)


@pytest.fixture(scope="module")
def code(folder: Path) -> str:
    return compiler.source(PLAN, sany.export("Constructs", folder), folder)


def test_each_construct_has_the_value_that_tlc_gives(
    code: str, of_tlc: dict[int, str], load: Load
) -> None:
    compiled = load(code).Constructs(3, frozenset({2, 3}))
    found = {n: shown(_tla(getattr(compiled, f"e{n}"))) for n in of_tlc}
    names = list(CONSTRUCTS)
    assert {names[n]: text for n, text in found.items()} == {
        names[n]: text for n, text in of_tlc.items()
    }
    assert len(of_tlc) == len(CONSTRUCTS)


@pytest.mark.slow
def test_a_case_without_an_arm_stops_as_tlc_does(code: str, folder: Path, load: Load) -> None:
    text = (folder / "Constructs.tla").read_text()
    line = text[: text.index("\nNothing")].count("\n") + 2
    with pytest.raises(NoArm, match=rf"Constructs\.tla:{line}$"):
        load(code).Constructs(3, frozenset()).nothing  # noqa: B018
    (folder / "Constructs.cfg").write_text(
        "CONSTANTS\n  Limit = 3\n  Some = {2}\nINIT Init\nNEXT Next\nINVARIANT Stops\n"
    )
    (folder / "Stops.tla").write_text(
        "---- MODULE Stops ----\nEXTENDS Constructs\nStops == Nothing = 1\n===="
    )
    with pytest.raises(tlc.TlcError):
        tlc.run("Stops", folder / "Constructs.cfg", tla_dir=folder, short=True)


REFUSED = {
    "CHOOSE n \\in Some : TRUE": "CHOOSE",
    "CHOOSE n : n = 1": "a bound name without a set",
    "[n \\in Some |-> n]": "a function [x \\in S |-> e]",
    "[Some -> Some]": "a set of functions [S -> T]",
    "[a : Some]": "a set of records [a : S]",
    "SUBSET Some": "SUBSET",
    "DOMAIN <<1, 2>>": "DOMAIN",
    "x": "a variable",
    "x'": "a primed expression",
    "\\E n : n = 1": "a bound name without a set",
    "\\E <<a, b>> \\in {<<1, 2>>} : a = b": "a tuple of bound names",
    "LET f(n) == n + 1 IN f(1)": "LET of an operator with parameters",
    "<<1, 2>>[Limit]": "a function applied to an argument that is not a number",
    "[<<1, 2>> EXCEPT ![1] = 2]": "EXCEPT of a function",
    "[[a |-> 1] EXCEPT !.a = 1, !.a = 2]": "EXCEPT changes a field twice",
    "[A EXCEPT !.a.b = 2]": "EXCEPT of a field of a field",
    "{LET a == n IN a : n \\in Some}": "LET within an expression",
    "{CASE n = 1 -> 2 [] OTHER -> 3 : n \\in Some}": "CASE within an expression",
    "Len(<<1>>)": "Len",
    "Limit * 2": "*",
    "Loop(1)": "RECURSIVE",
    "Twice(Plus, 1)": "an operator as argument",
    # TLC compares none of these; Python says False, or takes them for equal.
    "1 = TRUE": "values of different types",
    '1 = "a"': "values of different types",
    "{1} = <<1>>": "values of different types",
    "[a |-> 1] = <<1>>": "values of different types",
    "<<1, 2>> = <<1, TRUE>>": "values of different types",
    "1 \\in {TRUE}": "values of different types",
    '<<Plus(1), Same("a"), Same(1)>>': "values of different types",
    "{1} \\cup {FALSE}": "values of different types",
    "{1} \\in {1}": "values of different types",
    "IF TRUE THEN 1 ELSE FALSE": "values of different types",
    "IF 1 THEN 1 ELSE 2": "values of different types",
    "CASE TRUE -> 1 [] OTHER -> {}": "values of different types",
    "1 + TRUE": "values of different types",
    "1 /\\ TRUE": "values of different types",
    "UNION {1}": "values of different types",
    "Cardinality(1)": "values of different types",
    "\\E n \\in 1 : TRUE": "values of different types",
    "(1).a": "values of different types",
    "[a |-> 1].b": "a record without a field b",
    "[[a |-> 1] EXCEPT !.b = 2]": "a record without a field b",
    "<<1>>[2]": "no tuple with 2 elements",
    "A = B": "records that no tag distinguishes",
    "{A, B}": "records that no tag distinguishes",
    "[a |-> [b |-> 1]]": "two classes of records with the name",
}


@pytest.fixture(scope="module")
def refused(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    path = tmp_path_factory.mktemp("refused")
    loop = "RECURSIVE Loop(_)\nLoop(n) == Loop(n)\nTwice(F(_), n) == F(F(n))\nPlus(n) == n + 1\n"
    loop += "Same(n) == n\nA == [a |-> 1]\nB == [b |-> 1]\n"
    lines = [f"E{n} == {text}" for n, text in enumerate(REFUSED)]
    (path / "Refused.tla").write_text(_module("Refused", loop + "\n".join(lines) + "\n===="))
    return path, sany.export("Refused", path)


@pytest.mark.sweep(14)
@pytest.mark.parametrize("n", range(len(REFUSED)), ids=list(REFUSED))
def test_what_is_not_in_the_subset_is_named_with_its_line(
    n: int, refused: tuple[Path, bytes]
) -> None:
    folder, xml = refused
    plan = compiler.CompilerPlan("Refused", {f"E{n}": ()}, PLAN.constants)
    with pytest.raises(sany.NotCompiled) as caught:
        compiler.source(plan, xml, folder)
    lines = (folder / "Refused.tla").read_text().splitlines()
    (line,) = (k for k, text in enumerate(lines, 1) if text.startswith(f"E{n} =="))
    if caught.value.construct == "RECURSIVE":
        line = lines.index("Loop(n) == Loop(n)") + 1
    assert caught.value.construct.startswith(list(REFUSED.values())[n])
    assert str(caught.value).startswith(f"Refused.tla:{line}: cannot be compiled: ")


def test_an_argument_may_not_take_a_name_that_is_bound_where_it_goes(tmp_path: Path) -> None:
    (tmp_path / "Captured.tla").write_text(
        _module(
            "Captured",
            "F(c, a) == IF c THEN {a + n : n \\in Some} ELSE {}\n"
            "G(n) == F(TRUE, IF n = 1 THEN n ELSE 0)\nE == G(1)\n====",
        )
    )
    plan = compiler.CompilerPlan("Captured", {"E": ()}, PLAN.constants)
    with pytest.raises(sany.NotCompiled, match=r"Captured\.tla:6: .* a name that is bound there"):
        compiler.source(plan, sany.export("Captured", tmp_path), tmp_path)


def test_names() -> None:
    assert [snake(name) for name in ("OnCamLoss", "MyEntries", "In", "Me", "If")] == [
        *("on_cam_loss", "my_entries", "in_", "me", "if_")
    ]
    assert not re.search(r"[A-Z]", snake("StationTypeInv"))
