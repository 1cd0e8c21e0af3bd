"""The templates: they are written, they run, and they make no mistake in the protocol."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from cli_stage import automcm
from suite_stage import LIMIT

from automcm_conformance.adapter.check_adapter import check
from automcm_conformance.adapter.new_adapter import create, next_commands
from automcm_maintenance.code_mutation import cpp_station


def is_honest(*command: str) -> None:
    """No error; no Advertisement and no Intention yet."""
    found = check(command, LIMIT, lambda text: None)
    warned, good = ["warning"] * 2, ["ok"] * 4
    assert [finding.level for finding in found] == ["ok", *warned, *good], found


def test_the_python_template_runs(tmp_path: Path) -> None:
    written = create("python", tmp_path / "deep" / "adapter")
    assert [path.name for path in written] == ["adapter.py", "run"]
    is_honest(str(written[1]))


NEEDS = {
    "go": ("go",),
    "java": ("javac", "java"),
    "javascript": ("node",),
    "rust": ("cargo", "rustc"),
    "cpp": (),
}
"""Beside what ``cpp_station`` finds missing."""


@pytest.mark.sweep(1)
@pytest.mark.parametrize("language", NEEDS)
def test_a_template_that_is_compiled_runs(language: str, tmp_path: Path) -> None:
    lacking = [tool for tool in NEEDS[language] if not shutil.which(tool)]
    lacking += [cpp_station.missing()] if language == "cpp" else []
    if any(lacking):
        pytest.skip(f"{lacking[0]} is not installed: the {language} template was not run")
    create(language, tmp_path)
    *build, _, _ = next_commands(language, tmp_path)
    for command in build:
        done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "warning" not in done.stderr
    is_honest(str(tmp_path / "run"))


def test_the_javascript_template_tells_a_float_from_an_integer(tmp_path: Path) -> None:
    """JSON.parse cannot; 1.0 in a message is malformed (END-5)."""
    if not shutil.which("node"):
        pytest.skip("node is not installed: the parser of the javascript template was not run")
    create("javascript", tmp_path)
    adapter = (tmp_path / "adapter.js").read_text()
    parser = adapter[adapter.index("const TOKEN") : adapter.index("// TODO: replace this")]
    script = (
        parser
        + r"""
console.log(JSON.stringify(parse('{"a": 1.0, "b": [1, 2e3, -4], "c": "1.0 \\" 2.5"}')));
"""
    )
    done = subprocess.run(["node", "-e", script], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == {
        "a": {"not_an_integer": "1.0"},
        "b": [1, {"not_an_integer": "2e3"}, -4],
        "c": '1.0 " 2.5',
    }


def test_what_to_type_next() -> None:
    assert next_commands("python", Path("a b"))[-1] == "automcm conform run -- 'a b/run'"
    assert next_commands("cpp", Path("mine"))[0].startswith("cmake -S mine")


def test_what_cannot_be_created(tmp_path: Path) -> None:
    assert automcm("conform", "new", "--language", "cobol", tmp_path / "a").exit_code == 2
    (tmp_path / "file").write_text("mine")
    for target in (tmp_path, tmp_path / "file"):
        with pytest.raises(FileExistsError, match="is not an empty folder"):
            create("python", target)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    (tmp_path / "empty").mkdir()
    assert create("python", tmp_path / "empty")
