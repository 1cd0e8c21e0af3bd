"""docs/security.md: the tests that it names exist, and no input is executed."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from automcm_maintenance.documents import attacker_table
from automcm_spec.model_checking import models

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "security.md"
NAMED = re.findall(r"\[(test_\w+)\]\(\.\./([\w/]+\.py)\)", PAGE.read_text())
MODULES = ("pickle", "marshal", "shelve", "yaml", "gzip", "zipfile", "tarfile", "bz2", "zlib")
CALLS = ("eval", "exec", "os.system", "os.popen")
ALLOWED = {
    *(("mutated_process.py", "exec"), ("conditions.py", "exec"), ("kept_stages.py", "pickle")),
    ("lockstep.py", "zlib"),
}
"""A mutant that the kit has made itself; our own compiled station, with hooks; results that ``make
verify`` keeps in its own clone, which is code as much as they are; the reference's answers, which a
certificate keeps in its folder."""


def test_each_test_that_is_named_is_there() -> None:
    texts = {path: (ROOT / path).read_text() for _, path in NAMED}
    assert [
        name
        for name, path in NAMED
        if f"\ndef {name}(" not in texts[path] and f"\nasync def {name}(" not in texts[path]
    ] == []


def test_each_row_has_a_test_or_says_that_nothing_is_done() -> None:
    # What the models show is checked by TLC, not by a test.
    modelled = r"^### If every message is signed$.*?(?=^### )"
    page = re.sub(modelled, "", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    rows = [line for line in page.splitlines() if line.startswith("| ")]
    claims = [row for row in rows if "| test |" not in row]
    assert len(claims) >= 25
    assert [row for row in claims if "[test_" not in row and "**not protected**" not in row] == []


def found(text: str) -> set[str]:
    """What of the above a source imports or calls, and ``shell`` for ``shell=True``."""
    words = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            words |= {alias.name for alias in node.names} & set(MODULES)
        elif isinstance(node, ast.ImportFrom):
            words |= {str(node.module)} & set(MODULES)
        elif isinstance(node, ast.Call):
            words |= {ast.unparse(node.func)} & set(CALLS)
            words |= {word.arg for word in node.keywords if word.arg == "shell"}
    return words


def test_nothing_that_is_read_is_run() -> None:
    sources = [p for folder in ROOT.glob("*/**/automcm*") for p in folder.rglob("*.py")]
    assert len(sources) > 100
    named = re.compile(rf"\b({'|'.join(map(re.escape, (*MODULES, *CALLS, 'shell')))})\b")
    texts = [(path.name, text) for path in sources if named.search(text := path.read_text())]
    words = {(name, word) for name, text in texts for word in found(text)}
    assert words - ALLOWED == set()


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("import pickle", "pickle"),
        ("from yaml import load", "yaml"),
        ("eval(x)", "eval"),
        ("import os\nos.system(x)", "os.system"),
        ("run(x, shell=True)", "shell"),
    ],
)
def test_what_would_be_found(text: str, word: str) -> None:
    assert found(text) == {word}


def test_the_attacker_table_says_something_on_every_property_and_attacker() -> None:
    rows = attacker_table.table(models.load()).splitlines()[2:]
    cells = {row.split(" | ")[0].strip("| "): row.strip("| ").split(" | ")[1:] for row in rows}
    assert list(cells) == list(attacker_table.PROPERTIES)
    for property_, row in cells.items():
        assert len(row) == 3 and all(row), property_
    assert {p for p, (outsider, _, _) in cells.items() if "fails" in outsider} == set()
    assert {p for p, (_, insider, _) in cells.items() if "fails" in insider} == {
        *("S-4", "S-5", "S-8", "T-2", "T-6", "T-9")
    }
    assert all("holds" in cell for p, row in cells.items() for cell in row[:2])
