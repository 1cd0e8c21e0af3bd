"""``--help`` of every command: an example first, and nothing heavy to wait for."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator

import pytest
from cli_stage import automcm
from typer.main import get_command

from automcm_cli.main import app

HEAVY = (
    "numpy",
    "pydantic",
    "matplotlib",
    "asyncio",
    "statemachine",
    "hypothesis",
    "jinja2",
    "rich",
)


def commands(group: object, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], bool]]:
    """The path of each command, and whether it is a group of commands."""
    below = getattr(group, "commands", {})
    yield path, bool(below)
    for name in sorted(below):
        yield from commands(below[name], (*path, name))


WITHOUT_JSON = {
    # They run until they are stopped.
    *("adapter", "drive", "station", "link relay"),
    # They write files.
    *("generate", "spec pages", "experiment render", "conform new", "conform report"),
}
COMMANDS = dict(commands(get_command(app)))


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_each_command_begins_its_help_with_an_example(path: tuple[str, ...]) -> None:
    shown = automcm(*path, "--help")
    usage, example, _ = (*shown.output.split("\n\n"), "", "")[:3]
    assert shown.exit_code == 0 and ("Exit codes:" in shown.output) == (not path)
    assert usage.startswith("Usage:")
    assert COMMANDS[path] or re.search(
        f"Example: .*automcm {' '.join(path)}", " ".join(example.split())
    )
    has_json = "--json" in shown.output
    assert has_json != (COMMANDS[path] or " ".join(path) in WITHOUT_JSON)


def test_a_group_lists_its_commands_in_whole_sentences() -> None:
    for path in (path for path, group in COMMANDS.items() if group):
        shown = automcm(*path, "--help").output
        listed = re.findall(r"^  [a-z]\S+ {2,}(.*)", shown.partition("Commands:")[2], re.MULTILINE)
        assert len(listed) == sum(other[:-1] == path and bool(other) for other in COMMANDS)
        cut = [text for text in listed if text.endswith(("...", "Fig.")) or text[-1] not in ".?"]
        assert not cut


@pytest.mark.sweep(1)
@pytest.mark.parametrize("path", [[], ["trace"], ["trace", "explain"], ["conform", "run"]])
def test_help_loads_nothing_heavy(path: list[str]) -> None:
    code = (
        "import sys\nfrom automcm_cli.main import app\n"
        f"try:\n    app([*{path!r}, '--help'])\nexcept SystemExit:\n    pass\n"
        f"print(sorted(set({HEAVY!r}) & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "Usage:" in done.stdout and done.stderr.strip() == "[]"
