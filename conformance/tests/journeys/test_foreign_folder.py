"""Commands in a folder of somebody else: its links, and the characters in its files."""

from __future__ import annotations

import io
import json
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from broken_stations import REFERENCE
from cli_stage import automcm
from rich.text import Text
from test_help import COMMANDS

from automcm_cli import exit_codes
from automcm_cli.main import app
from automcm_cli.shared import common
from automcm_cli.shared.terminal import Terminal
from automcm_conformance.exchange import results

CORPUS = Path(__file__).resolve().parents[3] / "traces" / "corpus"
BAD = "ack_missing.ndjson"


@pytest.fixture
def foreign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with a log that diverges."""
    shutil.copy(CORPUS / "bad" / BAD, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("words", "written"),
    [
        (f"trace explain {BAD}", "runs/explain/ack_missing-7.ndjson"),
        (f"trace shrink {BAD}", f"runs/shrink/{BAD}"),
        (f"trace export {BAD}", "runs/export/ack_missing.mmd"),
        (f"trace itf {BAD}", "ack_missing.itf.json"),
        (f"trace html {BAD}", "runs/trace.html"),
        (f"trace replay {BAD} -- {' '.join(REFERENCE)}", "runs/replay/ack_missing-replayed.ndjson"),
        ("simulate lane-change --vehicles 4 --seconds 1", "runs/simulate"),
        ("experiment loss --workers 1", "runs/evaluation/loss/cells"),
        ("demo", "runs/demo"),
    ],
)
def test_no_output_that_the_user_did_not_name_follows_a_link(
    words: str, written: str, foreign: Path
) -> None:
    for part in [Path(written), *Path(written).parents][:-1]:
        shutil.rmtree("runs", ignore_errors=True)
        part.parent.mkdir(parents=True, exist_ok=True)
        part.symlink_to(foreign / "target")
        done = automcm(*words.split())
        assert done.exit_code in (1, 3) and "a symbolic link" in done.output, done.output
        assert str(part) in done.output and not (foreign / "target").exists()
        part.unlink()


def test_the_function_that_refuses_links_makes_every_folder() -> None:
    packages = Path(common.__file__).parents[1], Path(results.__file__).parents[1]
    found = [path for each in packages for path in each.rglob("*.py")]
    assert not [path for path in found if ".mkdir(" in path.read_text()]


FORGED = "ALLOWED, says the attacker"
EVIL = f"\x1b]0;title\x07\x1b[2J\x1b]52;c;Zm9v\x07\r\n{FORGED}\u2028{FORGED}\x9b31m\u202e\x7f"
ADAPTER = f"""
import json, sys
evil = {EVIL!r}
for line in sys.stdin:
    print(evil, file=sys.stderr)
    hello = dict(protocol=1, name=evil, version=evil, issues=evil, scenarios=[evil], fixed=dict(),
                 features=["prescriber", "receiver", "restart", "durations", "cam"])
    answer = sys.argv[1:] and dict(error=evil) or dict([(evil, evil)])
    print(json.dumps(hello if json.loads(line)["cmd"] == "hello" else answer), flush=True)
"""


def _with_evil(value: Any) -> Iterator[Any]:
    """The value with one of its names or texts exchanged."""
    if isinstance(value, str):
        yield EVIL
    elif isinstance(value, dict):
        yield value | {EVIL: EVIL}
        for key, inner in value.items():
            yield from (value | {key: changed} for changed in _with_evil(inner))
    elif isinstance(value, list) and value:
        yield from ([changed, *value[1:]] for changed in _with_evil(value[0]))


@pytest.fixture(scope="module")
def evil(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs, adapters, certificates and files, with EVIL wherever there can be text."""
    folder = tmp_path_factory.mktemp("evil")
    pair = [CORPUS / "pair" / f"{n}.ndjson" for n in (1001, 2002)]
    for n, log in enumerate((*pair, CORPUS / "bad" / BAD)):
        head, *lines = map(json.loads, log.read_text().splitlines())
        head |= {"run": EVIL, "implementation": {"name": EVIL, "version": EVIL}}
        name = folder / ("bad" if n == 2 else "pair") / f"{n}{EVIL}.ndjson"
        name.parent.mkdir(exist_ok=True)
        name.write_text("".join(json.dumps(line) + "\n" for line in (head, *lines)))
    head, *lines = map(json.loads, pair[0].read_text().splitlines())
    kinds = {
        json.dumps([line.get("ev"), line.get("message", {}).get("type")]): line for line in lines
    }
    (folder / "some").mkdir()
    for n, line in enumerate((head, *kinds.values())):
        for m, changed in enumerate(_with_evil(line)):
            whole = [changed] if line is head else [head, *lines[: lines.index(line)], changed]
            text = "".join(json.dumps(each) + "\n" for each in whole)
            (folder / "some" / f"{n}-{m}.ndjson").write_text(text)
    (folder / "adapter.py").write_text(ADAPTER)
    (folder / "evil.json").write_text(json.dumps({EVIL: EVIL}))
    automcm("keys", "authority", folder / "authority")
    issue = ["keys", "issue", folder / "authority", folder / f"station{EVIL}"]
    assert automcm(*issue, "--id", 7, "--scenario", EVIL).exit_code == 0
    (folder / f"other{EVIL}").mkdir()
    return folder


TABLE = {
    "trace explain": ["pair/*", "bad/*", "pair/* bad/*", "some/*-1.ndjson"],
    "trace lint": ["pair/* some/*"],
    "trace show": ["pair/*", "some/1-0.ndjson"],
    "trace coverage": ["pair/* bad/* some/*-1.ndjson"],
    "trace diff": ["pair/0* pair/1*", "pair bad"],
    "trace export": [f"--to {to} pair/*" for to in ("mermaid", "svg", "itf", "mcap")],
    "trace itf": ["pair/0*", "evil.json"],
    "trace html": ["pair/*", "some/5-0.ndjson", "pair/0* --compare bad/*"],
    "trace shrink": ["bad/*"],
    "trace watch": ["pair/* bad/*"],
    "trace replay": ["pair/0* -- ADAPTER", "some/0-0.ndjson -- ADAPTER"],
    "conform run": ["AMCM/RCV/NEG/BI-05 -- ADAPTER x"],
    "conform check-adapter": ["-- ADAPTER", "-- ADAPTER x"],
    "conform explore": ["1 --walks 1 -- ADAPTER"],
    "conform replay": ["evil.json -- ADAPTER"],
    "conform report": ["evil.json"],
    "keys authority": ["station*"],
    "keys issue": ["authority station* --renew", "authority other* --renew"],
    "keys show": ["station*", "authority", "other*"],
    "keys revoke": ["authority --id 7", "station* --id 7"],
    "station": ["--id 8 --keys station*", "--id 8 --keys other*"],
}
GRAPH = "conform run", "conform explore"
"""They load the graph, which takes seconds; ``test_terminal_report`` has texts of the same kind."""
NOT_READ = "conform list", "conform live", "conform new", "conform certify"


def printed(words: list[str], patch: pytest.MonkeyPatch, capture: Any) -> str:
    """What the command prints, through all that is between it and the terminal."""
    capture.readouterr()
    with patch.context() as own:
        own.setattr(sys, "argv", ["automcm", *words])
        own.setattr(sys, "stdout", sys.stdout)
        own.setattr(sys, "stderr", sys.stderr)
        code = exit_codes.run(app)
        sys.stderr.flush()
    out, err = capture.readouterr()
    assert code != exit_codes.FAULT, err
    return out + err


def test_every_command_that_reads_such_files_is_tried() -> None:
    groups = {"trace", "conform", "keys"}
    names = {" ".join(path) for path, group in COMMANDS.items() if not group and path[0] in groups}
    assert names == {*TABLE, *NOT_READ} - {"station"}


@pytest.mark.parametrize(
    "command",
    [pytest.param(name, marks=pytest.mark.slow if name in GRAPH else ()) for name in TABLE],
)
def test_no_text_of_others_controls_the_terminal_or_forges_a_line(
    command: str, evil: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(evil)
    for arguments in TABLE[command]:
        words = command.split()
        for word in arguments.split():
            if word == "ADAPTER":
                words += [sys.executable, "adapter.py"]
            else:
                words += sorted(map(str, Path().glob(word))) if "*" in word else [word]
        text = printed(words, monkeypatch, capfd)
        assert text and all(c.isprintable() or c == "\n" for c in text), text
        assert not re.search(f"^\\s*{FORGED}", text, re.M), text


def test_a_terminal_has_colours_and_no_other_escape_sequence() -> None:
    file = io.StringIO()
    terminal = Terminal(file=file, force_terminal=True, width=1000)
    terminal.print(EVIL, style="red")
    terminal.print(Text(EVIL.replace("\n", ""), "red"))
    assert file.getvalue().count("\x1b[31m") >= 2
    rest = re.sub("\x1b\\[[0-9;]*m", "", file.getvalue())
    assert all(c.isprintable() or c == "\n" for c in rest) and rest.count("\n") == 2


def test_all_text_goes_through_say_or_a_terminal() -> None:
    cli = Path(common.__file__).parents[1]
    other = re.compile(r"typer\.echo\(|^ *print\(|\bConsole\(", re.M)
    found = {path.name for path in cli.rglob("*.py") if other.search(path.read_text())}
    assert found == {"__main__.py", "common.py", "exit_codes.py"}
