"""Who may import whom, and what no committed file may hold."""

from __future__ import annotations

import ast
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
OURS = {"automcm_spec", "automcm", "automcm_traces", "automcm_conformance", "automcm_cli"}
MAY = {
    "spec/automcm_spec": {"automcm_spec"},
    "reference/automcm": {"automcm", "automcm_traces.writer"},
    "traces/automcm_traces": {"automcm_spec", "automcm_traces"},
    "conformance/automcm_conformance": {"automcm_spec", "automcm_traces", "automcm_conformance"},
    "conformance/automcm_cli": OURS,
}


def imported(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module)
    return {name for name in names if name.split(".")[0] in OURS}


@pytest.mark.parametrize("folder", MAY)
def test_who_imports_whom(folder: str) -> None:
    files = sorted((ROOT / folder).glob("*.py"))
    assert files
    for path in files:
        for name in imported(path):
            allowed = name in MAY[folder] or name.split(".")[0] in MAY[folder]
            assert allowed, f"{path.name} imports {name}"


def test_no_file_names_a_registry_or_this_machine() -> None:
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode:
        pytest.skip("not a git checkout: the files of the repository are not known")
    forbidden = [b"py" + b"pi.org", b"python" + b"hosted", b"repo1." + b"maven", b"/ro" + b"ot/"]
    found = [
        (name, word)
        for name in listed.stdout.splitlines()
        if (ROOT / name).is_file()
        for word in forbidden
        if word in (ROOT / name).read_bytes()
    ]
    assert found == []
