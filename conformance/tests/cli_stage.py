"""The command ``automcm``, run in this process; and how a process of its own is started."""

from __future__ import annotations

import io
import subprocess
import sys
from typing import Any

from click.testing import Result
from rich.console import Console
from typer.testing import CliRunner

from automcm_cli.main import app
from automcm_maintenance.verify import verify_screen
from automcm_maintenance.verify.verify import Report

AUTOMCM = [sys.executable, "-m", "automcm_cli"]
REFERENCE = [*AUTOMCM, "adapter"]
"""The adapter of the reference."""
LIMIT_S = 60
"""A process that takes longer hangs."""


def automcm(*words: object, **more: Any) -> Result:
    """What the command with these words prints and returns."""
    return CliRunner().invoke(app, [str(word) for word in words], **more)


def automcm_process(*words: object) -> subprocess.CompletedProcess[str]:
    """The same as a process."""
    command = [*AUTOMCM, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)


def shown(report: Report) -> str:
    """What ``automcm verify`` prints of a report."""
    console = Console(file=io.StringIO(), record=True, width=200)
    verify_screen.show(report, console)
    return console.export_text()
