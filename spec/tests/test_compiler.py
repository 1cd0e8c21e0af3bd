"""The compiled station is what Station.tla says: no drift, and a wrong compiler is seen."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import ModuleType
from typing import Any

import pytest

from automcm_spec import agreement, compiler, generate, oracle, sany, station, translate
from automcm_spec.names import snake
from automcm_spec.paths import TLA
from automcm_spec.sany import Node
from automcm_spec.translate import Translator

Load = Callable[[str], ModuleType]


@pytest.fixture(scope="module")
def tight() -> oracle.Oracle:
    return oracle.load(generate.TIGHT.path, generate.spec_hash())


def _made(module: ModuleType, constants: Mapping[str, Any]) -> Any:
    given = {
        snake(name): frozenset(value) if isinstance(value, list) else value
        for name, value in constants.items()
    }
    return module.OpenStation(**given)


def test_the_committed_station_is_what_would_be_generated(open_xml: bytes) -> None:
    assert compiler.PATH.read_text() == compiler.text(xml=open_xml)


def test_it_is_the_same_in_every_process(open_xml: bytes, tmp_path: Any) -> None:
    (tmp_path / "open.xml").write_bytes(open_xml)
    code = (
        "import sys; from automcm_spec import compiler, paths; "
        "xml = open(sys.argv[1], 'rb').read(); "
        "print(compiler.source(compiler.PLAN, xml, paths.TLA), end='')"
    )
    for seed in ("1", "2"):
        done = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path / "open.xml")],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout == compiler.source(compiler.PLAN, open_xml, TLA)


def test_an_edit_of_the_specification_is_followed(tmp_path: Any, load: Load) -> None:
    for path in TLA.glob("*.tla"):
        (tmp_path / path.name).write_text(path.read_text())
    text = (tmp_path / "Station.tla").read_text()
    old = 'ELSE IF st.backoff THEN Refuse(st, "END-7")'
    assert old in text
    edited = text.replace(old, 'ELSE IF st.number = 7 THEN Refuse(st, "END-9")')
    (tmp_path / "Station.tla").write_text(edited)
    code = compiler.source(compiler.PLAN, sany.export("OpenStation", tmp_path), tmp_path)
    one = load(code).Station(3, 1, 5, 4)
    request = station.Command("command", "request", (0, 0), 0, 0)
    assert one.step(1, one.initial._replace(number=7), request).rule == "END-9"
    assert one.step(1, one.initial._replace(backoff=True), request).rule == "ADV-1"


# Mutations of the compiler: what each changes, and how.


def _binary(op: str, python: str) -> Callable[[pytest.MonkeyPatch], None]:
    return lambda patch: patch.setitem(translate.BINARY, op, python)


def _node(op: str, change: Callable[[Node], Node]) -> Callable[[pytest.MonkeyPatch], None]:
    """Every node of this kind is read as another."""
    original = sany._Reader._application

    def read(self: Any, element: Any, at: Any) -> Node:
        node = original(self, element, at)
        return change(node) if node.op == op else node

    return lambda patch: patch.setattr(sany._Reader, "_application", read)


def _method(
    name: str, change: Callable[[Callable[..., Any]], Callable[..., Any]]
) -> Callable[[pytest.MonkeyPatch], None]:
    return lambda patch: patch.setattr(Translator, name, change(getattr(Translator, name)))


def _swap(n: int, m: int) -> Callable[[Node], Node]:
    def changed(node: Node) -> Node:
        args = list(node.args)
        args[n], args[m] = args[m], args[n]
        return replace(node, args=tuple(args))

    return changed


def _fewer(node: Node) -> Node:
    """Without the last of several parts."""
    return replace(node, args=node.args[:-1]) if len(node.args) > 2 else node


def _swap_fields(node: Node) -> Node:
    """The values of src and dst, where both are."""
    values = {pair.args[0].name: pair.args[1] for pair in node.args}
    if not {"src", "dst"} <= values.keys():
        return node
    other = {"src": "dst", "dst": "src"}
    return replace(
        node,
        args=tuple(
            replace(
                pair, args=(pair.args[0], values[other.get(pair.args[0].name, pair.args[0].name)])
            )
            for pair in node.args
        ),
    )


def _first_of_two(node: Node) -> Node:
    return replace(node, args=node.args[:1]) if len(node.args) == 2 else node


def _first_let_for_all(original: Callable[..., Any]) -> Callable[..., Any]:
    """Every definition of a LET is the first."""

    def bind(self: Translator, node: Node, pending: Any) -> Any:
        same = [(name, pending[0][1]) for name, _ in pending] if len(pending) == 2 else pending
        return original(self, node, same)

    return bind


def _bound_too_early(original: Callable[..., Any]) -> Callable[..., Any]:
    """What a LET needs of another is bound after it."""

    def bind(self: Translator, node: Node, pending: Any) -> Any:
        lines, value, left = original(self, node, pending)
        return lines[::-1], value, left

    return bind


def _edited(old: str, new: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Another text is written."""

    def change(original: Callable[..., Any]) -> Callable[..., Any]:
        return lambda self, *args: original(self, *args).replace(old, new)

    return change


MUTATIONS: dict[str, Callable[[pytest.MonkeyPatch], None]] = {
    "IF with its branches swapped": _node("$IfThenElse", _swap(1, 2)),
    "\\subseteq for \\in": _binary("\\in", "<="),
    "\\in for \\notin": _binary("\\notin", "in"),
    "= for #": _binary("/=", "=="),
    "<= for <": _binary("<", "<="),
    "a difference the wrong way": _node("\\", _swap(0, 1)),
    "\\cap for \\cup": _binary("\\union", "&"),
    "a lost EXCEPT path": _node("$Except", _fewer),
    "each LET is the first": _method("_bind", _first_let_for_all),
    "LET in the wrong order": _method("_bind", _bound_too_early),
    "CASE loses its last arm": _node("$Case", _fewer),
    "a list of /\\ loses its last": _node("$ConjList", _fewer),
    "\\/ for /\\": _method("condition", _edited(" and ", " or ")),
    "=> without not": _method("condition", _edited("(not ", "(")),
    "tuples count from 1": _method("expression", _edited("[0]", "[1]")),
    "a filter is forgotten": _node(
        "$SubsetOf", lambda node: replace(node, args=(Node("TRUE", node.at),))
    ),
    "any for all": _method("expression", _edited("all(", "any(")),
    "TRUE is 1": _method("expression", _edited("True", "1")),
    "a set of two loses one": _node("$SetEnumerate", _first_of_two),
    "a record with two fields swapped": _node("$RcdConstructor", _swap_fields),
    "+ is -": _binary("+", "-"),
}


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_wrong_compiler_is_seen(
    name: str, open_xml: bytes, tight: oracle.Oracle, load: Load, monkeypatch: pytest.MonkeyPatch
) -> None:
    MUTATIONS[name](monkeypatch)
    code = compiler.source(compiler.PLAN, open_xml, TLA)
    monkeypatch.undo()
    found = agreement.compare(tight, _made(load(code), tight.constants), stop_at_first=True)
    assert found.differences


def test_the_right_compiler_is_not(open_xml: bytes, tight: oracle.Oracle, load: Load) -> None:
    code = compiler.source(compiler.PLAN, open_xml, TLA)
    found = agreement.compare(tight, _made(load(code), tight.constants))
    assert (found.differences, found.states) == (0, len(tight.states))
    assert found.inputs == tight.transitions + tight.refusals
