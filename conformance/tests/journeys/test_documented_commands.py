"""Every command in the README and in docs/ exists with its options, and the quick ones are run.

A command is a line of a block of code that begins with ``automcm``, ``.venv/bin/automcm`` or
``make``.
"""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest
from cli_stage import automcm
from first_hour import python_station
from page_texts import PAGES, text
from typer.main import get_command

from automcm_cli.main import app

ROOT = Path(__file__).resolve().parents[3]
LINE = re.compile(r"(?: {4,}|)(?:- run: )?(?:\.venv/bin/)?((?:automcm|make) (?!--).*)")
PAIR = ROOT / "traces" / "corpus" / "pair"
LOGS = "1001.ndjson 2002.ndjson"
RUN = [
    "conform check-adapter -- mine/run",
    "conform list --explain AMCM/RCV/NEG/BI-04",
    "conform list NEG-4 --json -",
    "conform new --language cpp mine-cpp",
    "conform new --language python my_adapter",
    "spec check one_by_three",
    "spec list",
    "spec list --property T-2",
    "trace coverage logs/ --json coverage.json",
    "trace diff run-1 run-2 --times",
    f"trace explain {LOGS}",
    f"trace export {LOGS} --to mermaid",
    f"trace export {LOGS} --to mermaid --out runs/export",
    f"trace html {LOGS} --out page.html",
    "trace itf 1001.ndjson --out runs",
    "trace itf traces/corpus/pair/2002.ndjson --out runs",
    "trace itf traces/counterexamples/no_busy_refusal.itf.json --out runs",
    "trace lint 1001.ndjson logs/",
    "trace replay 2002.ndjson -- automcm adapter",
    f"trace show {LOGS} --session 1001/1",
    f"trace watch {LOGS}",
    "vectors check --kernel collide",
]
"""The commands of the pages that are run here; they end with 0."""


def commands(page: Path) -> list[str]:
    """Every command of a page."""
    found = set()
    fenced = False
    for line in text(page).splitlines():
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif (fenced or line.startswith("    ")) and (match := LINE.fullmatch(line)):
            command = re.sub(r"\s+#.*", "", match[1]).strip().removesuffix("\\").strip()
            found.add(command.replace(".venv/bin/automcm", "automcm"))
    return sorted(found)


PROGRAM = get_command(app)


def group_of(words: list[str]) -> tuple[Any, list[str]]:
    """The command that the first words name, and the other words."""
    command: Any = PROGRAM
    while words and hasattr(command, "commands"):
        assert words[0] in command.commands, f"no command {words[0]}"
        command, words = command.commands[words[0]], words[1:]
    return command, words


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_options_of_its_commands_exist_and_take_what_they_are_given(page: Path) -> None:
    for command in commands(page):
        if command.startswith("make "):
            continue
        words = shlex.split(command.replace("$(date +%Y%m%d)", "20260101"))[1:]
        found, arguments = group_of(words)
        if "[" in command:  # it says what may be typed
            known = {option for each in found.params for option in each.opts}
            named = set(re.findall(r"--[a-z-]+", command.split(" -- ")[0]))
            assert named and named <= known, command
        else:
            found.make_context("automcm", arguments)


def test_make_has_the_targets() -> None:
    rules = (ROOT / "Makefile").read_text()
    targets = {c.split()[-1] for page in PAGES for c in commands(page) if c.startswith("make ")}
    assert targets >= {"test", "verify"}
    assert {t for t in targets if not re.search(rf"^{re.escape(t)}:", rules, re.M)} == set()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the commands name: logs, folders of them, an adapter."""
    made = tmp_path_factory.mktemp("commands")
    for name in ("1001.ndjson", "2002.ndjson"):
        shutil.copy(PAIR / name, made)
    for name in ("logs", "run-1", "run-2"):
        shutil.copytree(PAIR, made / name)
    (made / "traces").symlink_to(ROOT / "traces")
    python_station(made / "mine")
    return made


@pytest.mark.sweep(2)
@pytest.mark.parametrize("command", RUN)
def test_it_runs(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert any(f"automcm {command}" in commands(page) for page in PAGES), "no page has it any more"
    monkeypatch.chdir(folder)
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=":")
    answer = automcm(*shlex.split(command))
    assert answer.exit_code == 0, answer.output
