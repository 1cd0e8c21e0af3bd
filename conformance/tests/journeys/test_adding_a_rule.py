"""docs/adding-a-rule.md on a copy of the repository: its diffs apply, and each command of sections
1 to 3 prints what the page says."""

from __future__ import annotations

import doctest
import re
import shlex
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest
from copied_tree import ROOT, copied, python

from automcm_conformance.suite import purposes

PAGE = ROOT / "docs" / "adding-a-rule.md"
STEP = re.compile(
    r"```diff\n--- (?P<path>\S+)\n(?P<diff>.*?)```"
    r"|^    \.venv/bin/(?P<command>automcm [^\n]*)\n\n```\n(?P<printed>.*?)```",
    re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Change:
    """A diff of the page: a file, and a text in it that another one replaces."""

    path: str
    old: str
    new: str


@dataclass(frozen=True)
class Command:
    """A command of the page and its output; ``...`` matches anything."""

    words: str
    printed: str


def steps() -> list[Change | Command]:
    """The diffs and commands of sections 1 to 3, in the order of the page."""
    found: list[Change | Command] = []
    for match in STEP.finditer(PAGE.read_text().split("\n## 4. ")[0]):
        if match["command"]:
            found.append(Command(match["command"], match["printed"]))
            continue
        lines = match["diff"].splitlines(keepends=True)
        assert {line[0] for line in lines} <= set(" -+")
        old, new = ("".join(line[1:] for line in lines if line[0] in kept) for kept in (" -", " +"))
        found.append(Change(match["path"], old, new))
    return found


STEPS = steps()


def test_every_diff_and_every_command_of_the_sections_is_a_step() -> None:
    text = PAGE.read_text().split("\n## 4. ")[0]
    assert sum(isinstance(step, Change) for step in STEPS) == text.count("```diff")
    assert sum(isinstance(step, Command) for step in STEPS) == text.count("\n    .venv/bin/")


def apply(change: Change, root: Path) -> None:
    path = root / change.path
    text = path.read_text()
    assert text.count(change.old) == 1, f"{change.path} does not have, once:\n{change.old}"
    path.write_text(text.replace(change.old, change.new))


def run(words: str, root: Path) -> str:
    return python(root, "-m", "automcm_cli", *shlex.split(words)[1:], codes=(0, 1))


def prints(command: Command, root: Path) -> None:
    """Lines of the page may be broken elsewhere than those on the screen."""
    found = run(command.words, root)
    wanted = f"...{command.printed.strip()}..."
    assert doctest.OutputChecker().check_output(
        wanted, found, doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    ), f"{command.words}\n{found}"


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return copied(tmp_path / "copy")


@pytest.mark.slow
def test_the_short_loop_of_the_page(copy: Path) -> None:
    for step in STEPS:
        if isinstance(step, Change):
            apply(step, copy)
        elif "--rule" in step.words:
            prints(step, copy)


@pytest.mark.deep
def test_the_page_command_by_command(copy: Path) -> None:
    for step in STEPS:
        if isinstance(step, Change):
            apply(step, copy)
        else:
            prints(step, copy)


def test_the_page_changes_the_rule_and_neither_the_tools_nor_the_kit() -> None:
    """Nothing that follows or explains a log, and nothing that drives a station, repeats a rule."""
    assert {step.path for step in STEPS if isinstance(step, Change)} == {
        "spec/tla/Station.tla",
        "spec/automcm_spec/vocabulary/rules.py",
        "reference/automcm/core/prescribing.py",
        "reference/automcm/core/phases.py",
    }
    table = re.findall(r"^\| .*", PAGE.read_text().split("\n## 4. ")[1].split("\n## ")[0], re.M)
    assert table and not re.search(r"automcm_(traces|conformance)/", "".join(table))


def test_the_case_of_the_page_is_the_next_of_its_series() -> None:
    (block,) = re.findall(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (case,) = tomllib.loads(block)["purpose"]
    series, _, number = case["id"].rpartition("-")
    there = [p.id.rpartition("-") for p in purposes.load()]
    assert int(number) == 1 + max(int(n) for s, _, n in there if s == series)
