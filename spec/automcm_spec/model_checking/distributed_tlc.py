"""One model on several machines: TLC's own server, and workers that join it.

TLC's distributed mode checks invariants and action properties, nothing temporal.  It says that
something is violated, but neither what nor by which steps: for that the model is checked alone.
Whoever reaches the server's port (10997) can join and read the specification: for a network
one trusts.  One server at a time fits on a machine.
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
from automcm_spec.support.paths import MODELS, TLA

LOOPBACK = "127.0.0.1"

_SUCCESS, _VIOLATION = "@!@!@STARTMSG 2193:", "@!@!@STARTMSG 2121:"
_COUNTS = re.compile(r"^(\d+) states generated, (\d+) distinct states found", re.MULTILINE)
_COMPUTED = re.compile(r"Computed: (\d+)")


@dataclass(frozen=True)
class Shared:
    """What the server found with its workers.  seconds is with the start of Java and the wait.

    ``states`` counts what the workers did twice as well, so it differs from run to run; if
    something is violated, ``distinct_states`` does too.
    """

    model: models.Model
    outcome: Literal["holds", "violates"]
    distinct_states: int
    states: int
    seconds: float

    @property
    def problem(self) -> str | None:
        """What was not as expected."""
        if self.outcome != self.model.expect:
            return f"the model {self.outcome}; expected: {self.model.expect}"
        if self.outcome == "holds" and self.distinct_states != self.model.distinct_states:
            return (
                f"distinct_states is {self.distinct_states}, {self.model.distinct_states} expected"
            )
        return None


def serve(
    model: models.Model,
    *,
    host: str = LOOPBACK,
    models_dir: Path = MODELS,
    tla_dir: Path = TLA,
    timeout_s: float | None = None,
    on_line: Callable[[str], None] = lambda line: None,
) -> Shared:
    """Check a model with the workers that join; without any it waits.

    ``host`` is the address under which workers reach this machine.  Raises tlc.TlcError if the
    model has a temporal property, or TLC gives no verdict in time.
    """
    checked = models.checked_in(models_dir / f"{model.cfg}.cfg")
    safety = {name for name, id_ in models.PROPERTY_IDS.items() if id_[0] in "ST"}
    if beyond := sorted(set(checked) - safety):
        raise tlc.TlcError("config", f"{model.cfg}: only safety is distributed, not {beyond[0]}")
    started = time.monotonic()
    with scratch.folder("server") as place:
        for path in tla_dir.glob("*.tla"):
            shutil.copy(path, place)
        # The workers ask the server for both by name, and it looks in its own folder.
        shutil.copy(models_dir / f"{model.cfg}.cfg", place / "Model.cfg")
        arguments = ["-tool", "-deadlock", "-fp", "0", "-metadir", str(place / "meta")]
        arguments += ["-config", "Model.cfg", model.module]
        said = _java("TLCServer", place, host, [], arguments, timeout_s, on_line)
    counts = _COUNTS.findall(said)
    if not counts or (_SUCCESS not in said and _VIOLATION not in said):
        raise tlc.TlcError("other", f"TLC's server broke off: {_end(said)}")
    states, distinct = map(int, counts[-1])
    outcome: Literal["holds", "violates"] = "violates" if _VIOLATION in said else "holds"
    return Shared(model, outcome, distinct, states, time.monotonic() - started)


def work(
    server: str, *, threads: int = 1, host: str = LOOPBACK, timeout_s: float | None = None
) -> int:
    """Join the server of that address until it has finished; the states computed here.

    Waits for the server if it is not there yet.  ``host`` is the address under which the server
    reaches this machine.  Raises tlc.TlcError if the server goes away or the time is over.
    """
    with scratch.folder("worker") as place:
        options = [f"-Dtlc2.tool.distributed.TLCWorker.threadCount={threads}"]
        said = _java("TLCWorker", place, host, options, [server], timeout_s)
    computed = _COMPUTED.findall(said)
    if not computed:
        raise tlc.TlcError("other", f"TLC's worker broke off: {_end(said)}")
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
    """Run a class of TLC's distributed mode in a folder of its own; all it says."""
    java, jar = tlc.tools()
    command = [str(java), "-Xss64m", "-XX:-UsePerfData", "-Duser.language=en"]
    command += [f"-Djava.io.tmpdir={place}", f"-Djava.rmi.server.hostname={host}", *options]
    command += [*tlc.quick_start(), "-cp", str(jar), f"tlc2.tool.distributed.{name}", *arguments]
    lines: list[str] = []

    def read(said: Iterable[str]) -> None:
        for line in said:
            lines.append(line)
            on_line(line.rstrip("\n"))

    tlc.execute(command, place, subprocess.STDOUT, timeout_s, read, name=name)
    return "".join(lines)


def _end(said: str) -> str:
    return " ".join(said.split()[-60:])
