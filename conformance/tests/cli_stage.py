"""The command ``automcm``, run in this process; and how a process of its own is started."""

from __future__ import annotations

import io
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from click.testing import Result
from forked_station import automcm_popen
from rich.console import Console
from typer.testing import CliRunner

from automcm_cli.main import app
from automcm_maintenance.verify import verify_screen
from automcm_maintenance.verify.graph_comparison import Coverage, WalkResult
from automcm_maintenance.verify.verify import VerifyReport
from automcm_spec.graph.oracle_agreement import Agreement
from automcm_spec.model_checking import models
from automcm_spec.model_checking.tlc import TlcResult

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
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with automcm_popen(*words, **pipes) as process:
        out, err = process.communicate(timeout=LIMIT_S)
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def own_address() -> str:
    """A loopback address of this process alone: every port is free there."""
    pid = os.getpid()
    return f"127.{1 + (pid >> 16) % 250}.{(pid >> 8) % 256}.{pid % 256}"


@contextmanager
def broadcast() -> Iterator[str]:
    """Where to broadcast: a port that a socket keeps from others, and the stations share."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as kept:
        kept.bind(("127.255.255.255", 0))
        kept.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        yield f"127.255.255.255:{kept.getsockname()[1]}"


def shown(report: VerifyReport) -> str:
    """What ``automcm verify`` prints of a report."""
    console = Console(file=io.StringIO(), record=True, width=200)
    verify_screen.show(report, console)
    return console.export_text()


def good_report() -> VerifyReport:
    """Of ``automcm verify``, with nothing wrong."""
    model = models.load()[0]
    result = TlcResult("holds", None, 10, 20, 3, 0.1)
    return VerifyReport(
        profile="quick",
        verdicts=[models.ModelVerdict(model, "holds", None, result, None)],
        oracle={"states": 1, "transitions": 2, "refusals": 3, "spec_hash": "0" * 64},
        compared={"one-peer": WalkResult(states=1, inputs=5)},
        compiled={"one-peer": Agreement(states=1, inputs=6)},
        coverage=Coverage(covered={"NEG-4": "NEG-4"}),
        behaviours=3,
        seconds={"models": 1.0},
    )
