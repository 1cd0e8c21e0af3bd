"""Checks one model on several machines, with TLC's server and the workers that join it.

TLC's distributed mode checks invariants and action properties, but no temporal properties. It
reports that something is violated, but neither the property nor the steps; for these, check the
model on one machine. Anyone who reaches the server's port (10997) can join and read the
specification, so use it only in a trusted network. Only one server at a time runs on a machine.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from automcm_spec.model_checking import models, tlc
from automcm_spec.support import scratch
from automcm_spec.support.paths import TLA

LOOPBACK = "127.0.0.1"

_SUCCESS, _VIOLATION = "@!@!@STARTMSG 2193:", "@!@!@STARTMSG 2121:"
_COUNTS = re.compile(r"^(\d+) states generated, (\d+) distinct states found", re.MULTILINE)
_COMPUTED = re.compile(r"Computed: (\d+)")


@dataclass(frozen=True)
class Shared:
    """The result of the server and its workers. seconds includes the start of Java and the wait.

    ``states`` includes work done twice, so it differs from run to run; if something is violated,
    ``distinct_states`` does too.
    """

    model: models.Model
    outcome: Literal["holds", "violates"]
    distinct_states: int
    states: int
    seconds: float

    @property
    def problem(self) -> str | None:
        """The difference from the expected result; None if there is none."""
        if self.outcome != self.model.expect:
            return f"the model {self.outcome}; expected {self.model.expect}"
        if self.outcome == "holds" and self.distinct_states != self.model.distinct_states:
            return (
                f"distinct_states is {self.distinct_states}, expected {self.model.distinct_states}"
            )
        return None


def serve(
    model: models.Model,
    *,
    host: str = LOOPBACK,
    tla_dir: Path = TLA,
    timeout_s: float | None = None,
    on_line: Callable[[str], None] = lambda line: None,
) -> Shared:
    """Check a model with the workers that join; wait until there is one.

    ``host`` is the address of this machine for the workers. Raises tlc.TlcError if the model has a
    temporal property, or if TLC gives no verdict in time.
    """
    checked = models.checked_in(model.config)
    safety = {name for name, id_ in models.PROPERTY_IDS.items() if id_[0] in "ST"}
    if beyond := sorted(set(checked) - safety):
        raise tlc.TlcError(
            "config", f"{model.cfg}: {beyond[0]} cannot be checked distributed; only S and T can"
        )
    started = time.monotonic()
    with scratch.folder("server") as place:
        for path in tla_dir.glob("*.tla"):
            shutil.copy(path, place)
        # The workers fetch both by name from the server, which reads its own folder.
        (place / "Model.cfg").write_text(model.config, encoding="utf-8")
        arguments = ["-tool", "-deadlock", "-fp", "0", "-metadir", str(place / "meta")]
        arguments += ["-config", "Model.cfg", model.module]
        output = _java("TLCServer", place, host, [], arguments, timeout_s, on_line)
    counts = _COUNTS.findall(output)
    if not counts or (_SUCCESS not in output and _VIOLATION not in output):
        raise tlc.TlcError("other", f"TLC's server ended without a result: {_end(output)}")
    states, distinct = map(int, counts[-1])
    outcome: Literal["holds", "violates"] = "violates" if _VIOLATION in output else "holds"
    return Shared(model, outcome, distinct, states, time.monotonic() - started)


def work(
    server: str, *, threads: int = 1, host: str = LOOPBACK, timeout_s: float | None = None
) -> int:
    """Join the server at that address until it finishes; returns the number of states computed
    here.

    Waits for the server if it is not running yet. ``host`` is the address of this machine for the
    server. Raises tlc.TlcError if the server disappears or the time is over.
    """
    with scratch.folder("worker") as place:
        options = [f"-Dtlc2.tool.distributed.TLCWorker.threadCount={threads}"]
        output = _java("TLCWorker", place, host, options, [server], timeout_s)
    computed = _COMPUTED.findall(output)
    if not computed:
        raise tlc.TlcError("other", f"TLC's worker ended without a result: {_end(output)}")
    return sum(map(int, computed))


def _java(
    name: str,
    place: Path,
    host: str,
    options: Sequence[str],
    arguments: Sequence[str],
    timeout_s: float | None,
    on_line: Callable[[str], None] = lambda line: None,
) -> str:
    """Run a class of TLC's distributed mode in a folder of its own; returns its output."""
    java, jar = tlc.tools()
    command = [str(java), "-Xss64m", "-XX:-UsePerfData", "-Duser.language=en"]
    command += [f"-Djava.io.tmpdir={place}", f"-Djava.rmi.server.hostname={host}", *options]
    command += [*tlc.quick_start(), "-cp", str(jar), f"tlc2.tool.distributed.{name}", *arguments]
    lines: list[str] = []

    def read(output: Iterable[str]) -> None:
        for line in output:
            lines.append(line)
            on_line(line.rstrip("\n"))

    tlc.execute(command, place, subprocess.STDOUT, timeout_s, read, name=name)
    return "".join(lines)


def _end(output: str) -> str:
    return " ".join(output.split()[-60:])
