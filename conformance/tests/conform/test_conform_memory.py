"""The memory of a whole run."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from broken_stations import REFERENCE, broken
from cli_stage import AUTOMCM

MOST_MB = 300


@pytest.mark.slow
@pytest.mark.deep
@pytest.mark.parametrize("bug", ["", "no_ack_of_a_copy"])
def test_a_whole_run_takes_little_memory(bug: str, tmp_path: Path) -> None:
    station = broken(bug) if bug else REFERENCE
    command = [*AUTOMCM, "conform", "run", "--out", str(tmp_path), "--", *station]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    assert os.waitstatus_to_exitcode(status) == bool(bug)
    assert used.ru_maxrss / 1024 < MOST_MB
