"""SANY's XML: parse errors are located, and the result agrees with the module."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest

from automcm_maintenance.compilation import sany
from automcm_spec.model_checking import tlc
from automcm_spec.support.paths import TLA


def module(folder: Path, text: str) -> Path:
    (folder / "Some.tla").write_text(f"---- MODULE Some ----\n{text}\n====\n")
    return folder


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("EXTENDS Naturals\nA == 1 +", None, "Could not parse module Some"),
        ("EXTENDS Naturals\nA == 1 + Missing", 3, "Unknown operator: `Missing'"),
        ("VARIABLE x\nA(x) == x", 3, "Multiply-defined symbol 'x'"),
    ],
)
def test_a_wrong_module_is_named_with_its_line(
    text: str, line: int | None, said: str, tmp_path: Path
) -> None:
    with pytest.raises(tlc.TlcError, match="SANY: ") as caught:
        sany.export("Some", module(tmp_path, text))
    error = caught.value
    assert (error.kind, error.module, error.line) == ("parse", "Some", line)
    assert said in str(error) and "at tla2sany" not in str(error)


def test_operators_and_constants_are_in_the_order_of_the_text(open_xml: bytes) -> None:
    spec = sany.read(open_xml)
    names = list(spec.operators)
    assert names.index("Step") < names.index("StationTypeInv") < names.index("Me")
    assert list(spec.constants.items())[2:5] == [
        ("OutboxLimit", "Station"),
        ("MemoryLimit", "Station"),
        ("Peers", "OpenStation"),
    ]
    lines = (TLA / "Station.tla").read_text().splitlines()
    step = spec.operators["Step"]
    assert step.params == ("me", "st", "i")
    assert lines[step.at.line - 1].startswith("Step(me, st, i) ==")
    assert "r" not in names and "acked" not in names  # of LETs


def test_names_are_replaced_below_everything() -> None:
    at = tlc.Location("M", 1, 1, 1, 1)
    x, y = sany.Node("name", at, "x"), sany.Node("name", at, "y")
    some = sany.Node("$SubsetOf", at, "", (sany.Node("=", at, "", (x, y)),), (("z", x),))
    put = some.put({"x": y})
    assert [node.name for node in put.walk() if node.op == "name"] == ["y", "y", "y"]
    assert [name for name, _ in put.bounds] == ["z"] and some.args[0].args[0] == x


@pytest.mark.slow
def test_two_at_once_do_not_take_each_other_the_standard_modules_away(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """SANY unpacks them into Java's temporary folder, and deletes them at its end: of sixty runs,
    three at a time in one folder, four failed."""
    folders: list[str] = []
    run = subprocess.run

    def seen(command: list[str], **how: Any) -> Any:
        told = [word for word in command if word.startswith("-Djava.io.tmpdir=")]
        folders.append(told[-1].partition("=")[2])
        assert Path(folders[-1]).is_dir()
        return run(command, **how)

    monkeypatch.setattr(subprocess, "run", seen)
    for _ in range(2):
        assert sany.export("OpenStation").startswith(b"<?xml")
    assert len(set(folders)) == 2 and not any(Path(folder).exists() for folder in folders)
