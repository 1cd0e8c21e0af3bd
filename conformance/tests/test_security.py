"""docs/security.md: the tests that it names exist, and no input is executed."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from automcm_maintenance.documents.import_graph import PACKAGES

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "security.md"
NAMED = re.findall(r"\[(test_\w+)\]\(\.\./([\w/]+\.py)\)", PAGE.read_text())
MODULES = ("pickle", "marshal", "shelve", "yaml", "gzip", "zipfile", "tarfile", "bz2", "zlib")
CALLS = ("eval", "exec", "os.system", "os.popen")
ALLOWED = {("mutated_process.py", "exec"), ("conditions.py", "exec")}
"""A mutant that the kit has made itself; our own compiled station, with hooks."""


@pytest.mark.parametrize(("name", "path"), NAMED, ids=lambda each: each)
def test_each_test_that_is_named_is_there(name: str, path: str) -> None:
    tree = ast.parse((ROOT / path).read_text())
    assert name in {
        node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    }


def test_each_row_has_a_test_or_says_that_nothing_is_done() -> None:
    rows = [line for line in PAGE.read_text().splitlines() if line.startswith("| ")]
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
    sources = [p for name, folder in PACKAGES.items() for p in (ROOT / folder / name).rglob("*.py")]
    assert len(sources) > 100
    words = {(path.name, word) for path in sources for word in found(path.read_text())}
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
