"""Text that no committed file may contain."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


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
