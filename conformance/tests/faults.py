"""Every system call of a station made to fail, in every phase: what its peer notices, and when.

    python conformance/tests/faults.py [--write PAGE] [--only TEXT] [--jobs N]

A station (faulty_station.py) and a peer coordinate over UDP.  When the station first enters the
phase of a cell, a fault begins.  A cell says how the session ended for the peer.  Whatever fails:

* the peer is told by a message, or by the end of CAMs, at most D + t_cam_loss after the station
  has left the session (T-2), and no CAM names a session that the station has left (ACT-5);
* the station ends when it is told to, with the exit code of its fault;
* its log can be read, and is allowed, or cannot tell, or diverges where the fault says so.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from faulty_station import FAULTS, JUMP_S

from automcm.core.outcome import Heard
from automcm.core.state import State
from automcm.core.station import Effects
from automcm.links.clock import AsyncioClock
from automcm.links.udp_link import BROADCAST_HOST, UdpLink
from automcm.scenarios.straight_lane import LANE_CHANGE, Straight
from automcm.service.service import McService
from automcm_spec.vocabulary.messages import Cam
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.explain.explain import explain_file

HERE = Path(__file__).parent
SETTINGS = {"t_timeout": 300, "t_resend": 50, "t_cam_loss": 1100, "t_decide": 300}
LATE_MS = 150
"""How late a timer or a CAM of a process on a busy machine may be."""
MANEUVER_MS = 2000
ENDING_S = 4
CAMS_S = 0.5
"""How long CAMs are looked at after the session."""
LIMIT_S = 14
RETRIES = 2
PHASES = (
    ("none", "STANDALONE", "prescriber"),
    ("prescriber", "ADVERTISING", "prescriber"),
    ("prescriber", "CHOOSING", "prescriber"),
    ("prescriber", "PRESCRIBING", "prescriber"),
    ("prescriber", "NEGOTIATING", "prescriber"),
    ("prescriber", "ACTUATING", "prescriber"),
    ("none", "STANDALONE", "receiver"),
    ("receiver", "INTENDING", "receiver"),
    ("receiver", "WAITING", "receiver"),
    ("receiver", "NEGOTIATING", "receiver"),
    ("receiver", "ACTUATING", "receiver"),
)
"""Role and phase in which the fault begins, and the part that the station plays later."""


class Why(NamedTuple):
    """What a fault does, for the page, and what may come of it."""

    text: str
    acting: tuple[str, ...]
    """How the session may end for the peer if the fault begins in ACTUATING."""
    codes: tuple[int, ...] = (0,)
    diverges: bool = False
    ends: bool = False
    """The process ends by itself, at once or with its session."""
    everywhere: bool = False
    """The session ends so in whatever phase the fault begins."""


GOES_ON = "Lost records are counted; the session continues."
STOPS = "The station leaves with a Cancel (END-1) and exits."
LOG = (0, 3)
OURS = (1, 70)
FIN, CAMS, ABORT = ("Fin",), ("end of CAMs",), ("Cancel(abort)",)


def unharmed(text: str, codes: tuple[int, ...] = (0,)) -> Why:
    """Nobody notices anything."""
    return Why(text, FIN, codes, everywhere=True)


def only_new(text: str) -> Why:
    """A session goes on; a new one is not begun."""
    return Why(text, FIN, LOG, diverges=True)


def stops(text: str = STOPS, codes: tuple[int, ...] = (0,)) -> Why:
    """The process stops in order."""
    return Why(text, ABORT, codes, ends=True)


WHY: dict[str, Why] = {
    "nothing": unharmed("No fault."),
    "send refused": Why("Messages and CAMs are lost; the peer leaves by its timers.", CAMS),
    "send refused now and then": unharmed("Lost messages are resent."),
    "receive fails": Why(
        "The station receives nothing. Its timers end the session with a Cancel.",
        ("Cancel(cam_loss)",),
    ),
    "select fails": Why("The event loop and the CAMs stop at once.", CAMS, (3,)),
    "names cannot be looked up": unharmed("None: addresses are numeric."),
    "log: no space": unharmed(GOES_ON + " Exit code 3 reports lost log records.", LOG),
    "log: input/output error": unharmed("As without space.", LOG),
    "log: space for half a line": unharmed("As without space. The half line is removed.", LOG),
    "log: write blocks": unharmed("As without space: only the writer thread waits.", LOG),
    "standard output: no space": unharmed(GOES_ON),
    "standard output: closed": unharmed(GOES_ON),
    "standard output: blocks": unharmed(GOES_ON),
    "every write blocks": unharmed("Log and reports are lost; the session continues.", LOG),
    "number file: no space": only_new(
        "Only a new session needs the file. Its messages are not sent (END-8), the log diverges, "
        "and the process exits."
    ),
    "number file: rename fails": only_new("As without space."),
    "no file can be opened": only_new("As for the number file."),
    "no descriptor is free": only_new("As for the number file; nothing else needs a descriptor."),
    "memory limit": Why(
        "Python's reserve usually lasts for a session. Otherwise as without memory.",
        FIN + ABORT,
        (0, *OURS),
        ends=True,
    ),
    "no memory now and then": stops(codes=OURS),
    "time jumps ahead": Why(
        "All timers are due. The station leaves, by ACT-2 if it acts.",
        ("Cancel(cam_loss)",),
        diverges=True,
    ),
    "time goes back": Why(
        "No timer is due and no CAM is sent until time has caught up.", CAMS, diverges=True
    ),
    "time stands still": Why("No timer is ever due; no CAMs are sent.", CAMS, diverges=True),
    "the host sleeps": Why(
        "As if time jumped ahead, because the peer was awake.",
        ("Cancel(cam_loss)",),
        diverges=True,
    ),
    "the position raises": stops(codes=OURS),
    "the application raises": stops(
        STOPS + " If the application is not called again, the session continues.", (0, *OURS)
    ),
    "SIGTERM": stops(),
    "SIGTERM twice": stops(
        "The second signal ends the process at once; the Cancel is sent once.", (0, -signal.SIGTERM)
    ),
    "SIGINT": stops(),
    "SIGHUP": stops(),
    "SIGPIPE": unharmed("The signal is ignored."),
    "SIGUSR1": Why("The system kills the process; the CAMs stop.", CAMS, (-signal.SIGUSR1,)),
    "SIGKILL": Why("The CAMs stop.", CAMS, (-signal.SIGKILL,)),
    "SIGSTOP": Why(
        "The process is stopped until its peer has left; the CAMs stop. Then due timers end the "
        "session, and the log has late_ms.",
        CAMS,
        diverges=True,
    ),
}


@dataclass
class Cell:
    """One fault in one phase, and what came of it."""

    fault: str
    role: str
    phase: str
    part: str
    folder: Path
    port: int
    truth: list[dict[str, Any]] = field(default_factory=list)
    marked: list[tuple[float, tuple[tuple[int, int], ...]]] = field(default_factory=list)
    """When a CAM of the station came, and what it named."""
    way: list[tuple[float, str, str, str]] = field(default_factory=list)
    """The peer's phases: when, which, by which rule, and the reason of the message if any."""
    tries: int = 1
    code: int | None = None
    outcome: str = ""
    verdict: str = ""
    problems: list[str] = field(default_factory=list)

    @property
    def began(self) -> bool:
        """Whether the fault did."""
        return any("fault" in line for line in self.truth)

    def forget(self) -> None:
        """Be ready for another try."""
        self.truth, self.marked, self.way, self.problems = [], [], [], []
        self.tries += 1
        for path in self.folder.iterdir():
            path.unlink()

    async def run(self) -> None:
        """The whole cell; ``problems`` says what is wrong."""
        parameters = Parameters(**SETTINGS)
        asks = self.part == "prescriber"
        application = Straight(maneuver_ms=MANEUVER_MS, concerned_by_all=asks, hold_ms=300)
        link = UdpLink(broadcast=(BROADCAST_HOST, self.port))
        peer = McService(
            2, application, link, AsyncioClock(), parameters=parameters, observers=(self._observe,)
        )
        self._peer = peer
        peer.start()
        process, reading = await self._start(asks)
        told = asyncio.create_task(self._listen(reading))
        try:
            await self._until(lambda: any("ready" in line for line in self.truth), LIMIT_S)
            if not asks:
                peer.command(LANE_CHANGE, 200)
            await self._until(lambda: self.began and self._over(process), LIMIT_S)
            if self.fault == "SIGSTOP":
                os.kill(process.pid, signal.SIGCONT)
            await self._until(lambda: self._alone(process), ENDING_S)
            if WHY[self.fault].ends:
                await self._until(lambda: process.returncode is not None, ENDING_S)
            if process.returncode is None:
                await asyncio.sleep(CAMS_S)
                with suppress(ProcessLookupError):
                    os.kill(process.pid, signal.SIGTERM)  # asyncio's own may swallow the exit code
            with suppress(TimeoutError):
                self.code = await asyncio.wait_for(process.wait(), ENDING_S)
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
            await told
            peer.close()
        self._judge()

    async def _start(self, asks: bool) -> tuple[asyncio.subprocess.Process, int]:
        reading, writing = os.pipe()
        options = [f"{name}={value}" for name, value in SETTINGS.items()]
        request = ["--request-after", "400", "--no-concerned"] if asks else []
        number = ["--number-file", str(self.folder / "number"), "--first"]
        with open(self.folder / "stderr", "wb") as errors:
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, str(HERE / "faulty_station.py"), self.fault),
                *(self.role, self.phase, str(writing)),
                *("--id", "1", "--listen", "0", "--log", str(self.folder / "1.ndjson")),
                *("--broadcast", f"{BROADCAST_HOST}:{self.port}"),
                *(word for option in options for word in ("--set", option)),
                *("--maneuver", str(MANEUVER_MS), *request, *number),
                stdout=asyncio.subprocess.DEVNULL,
                stderr=errors,
                pass_fds=(writing,),
            )
        os.close(writing)
        return process, reading

    async def _listen(self, reading: int) -> None:
        """What the station really does."""
        stream = asyncio.StreamReader()
        protocol = asyncio.StreamReaderProtocol(stream)
        loop = asyncio.get_running_loop()
        await loop.connect_read_pipe(lambda: protocol, os.fdopen(reading, "rb"))
        async for line in stream:
            self.truth.append(json.loads(line))

    async def _until(self, so: Any, limit_s: float) -> None:
        end = time.monotonic() + limit_s
        while not so() and time.monotonic() < end:
            await asyncio.sleep(0.02)

    def _over(self, process: asyncio.subprocess.Process) -> bool:
        """The peer has left a session, or will not get into one."""
        if self.way and self.way[-1][1] == "STANDALONE":
            return True
        return not self.way and process.returncode is not None

    def _alone(self, process: asyncio.subprocess.Process) -> bool:
        """Nobody is in a session, and nobody has anything left to send."""
        gone = process.returncode is not None or self.truth[-1].get("phase") == "STANDALONE"
        return gone and not self._peer.state.outbox

    def _observe(self, before: State, effects: Effects) -> None:
        now = time.monotonic()
        if isinstance(effects.input, Cam) and effects.input.src == 1:
            self.marked.append((now, effects.input.marks))
        if before.phase != effects.state.phase:
            reason = ""
            if isinstance(effects.input, Heard):
                reason = str(getattr(effects.input.message, "reason", "") or "")
                self._session = effects.input.message.session
            self.way.append((now, effects.state.phase, effects.rule, reason))

    # -- what came of it

    def _judge(self) -> None:
        why = WHY[self.fault]
        if not self.began:
            self.problems.append("the fault never began")
        self.outcome = self._how()
        if self.outcome not in why.acting and (self.phase == "ACTUATING" or why.everywhere):
            self.problems.append(f"{self.outcome}, not {' or '.join(why.acting)}")
        if self.code is None:
            self.problems.append("it did not end when it was told to")
        elif self.code not in why.codes:
            self.problems.append(f"exit code {self.code}, not one of {why.codes}")
        self._judge_cams()
        self._judge_log(why)

    def _how(self) -> str:
        """How the session ended for the peer."""
        if not self.way:
            return "no session"
        if self.way[-1][1] != "STANDALONE":
            self.problems.append(f"the peer is still {self.way[-1][1]}")
            return "never"
        rule, reason = self.way[-1][2:]
        return {"ACT-2": "end of CAMs", "ACT-3": "Fin"}.get(
            rule, f"Cancel({reason})" if reason and rule == "END-2" else f"timer ({rule})"
        )

    def _judge_cams(self) -> None:
        """ACT-5 and T-2: no CAM names what the station has left; and the peer does not act on."""
        left: dict[tuple[int, int], float] = {}
        for line in self.truth:
            marks = {tuple(mark) for mark in line.get("marks", ())}
            for mark in marks:
                left.pop(mark, None)
            if "marks" in line:
                for known in {m for _, ms in self.marked for m in ms} - marks:
                    left.setdefault(known, line["s"])
        for at, marks in self.marked:
            for mark in marks:
                after = (at - left.get(mark, at)) * 1000
                if after > LATE_MS:
                    self.problems.append(f"a CAM named {mark} {after:.0f} ms after it was left")
        acting = [n for n, step in enumerate(self.way) if step[1] == "ACTUATING"]
        if acting and acting[0] + 1 < len(self.way):
            end = self.way[acting[0] + 1][0]
            last = max((at for at, marks in self.marked if marks and at <= end), default=end)
            lasted = (end - min([last, *left.values()])) * 1000
            late = max(LATE_MS, self._peer.statistics.latest_ms)
            bound = SETTINGS["t_cam_loss"] + SETTINGS["t_resend"] // 2 + late
            if lasted > bound:
                self.problems.append(f"the peer acted {lasted:.0f} ms after the station had left")

    def _judge_log(self, why: Why) -> None:
        log = self.folder / "1.ndjson"
        late = [json.loads(line).get("late_ms", 0) for line in log.read_bytes().splitlines()]
        verdict = explain_file(log, max(LATE_MS, *late))  # it says itself when it was late
        self.verdict = verdict.verdict
        if self.verdict == "unreadable" or (self.verdict == "diverges" and not why.diverges):
            self.problems.append(
                f"log {self.verdict}: line {verdict.finding.at.line}: {verdict.finding.observed}"
            )


async def matrix(faults: Sequence[str], jobs: int, folder: Path) -> list[Cell]:
    """All cells, some at a time."""
    places = [(fault, *phase) for fault in faults for phase in PHASES]
    cells = []
    for n, (fault, role, phase, part) in enumerate(places):
        own = folder / str(n)
        own.mkdir()
        cells.append(Cell(fault, role, phase, part, own, 48_000 + n))
    free = asyncio.Semaphore(jobs)

    async def one(cell: Cell) -> None:
        async with free:
            await cell.run()
            for _ in range(RETRIES):  # a busy machine is late, or an Ack is overtaken
                if cell.problems:
                    cell.forget()
                    await cell.run()
        if sys.stderr.isatty():
            print(f"{cell.fault}, {cell.phase}: {cell.outcome}", file=sys.stderr)

    await asyncio.gather(*(one(cell) for cell in cells))
    return cells


def page(cells: Sequence[Cell]) -> str:
    """The matrix in Markdown."""
    heads = [f"{phase} ({part})" for _, phase, part in PHASES]
    wide, narrow = [], []
    for fault in FAULTS:
        row = [cell for cell in cells if cell.fault == fault]
        if not row:
            continue
        codes = ", ".join(str(code) for code in sorted({c.code for c in row if c.code is not None}))
        verdicts = ", ".join(sorted({cell.verdict.replace("_", " ") for cell in row}))
        outcomes = [cell.outcome + ("" if not cell.problems else " **(!)**") for cell in row]
        if any(outcome != "Fin" for outcome in outcomes):
            wide.append([fault, *outcomes])
        narrow.append([fault, codes, verdicts, WHY[fault].text])
    wide, narrow = _alike(wide), _alike(narrow)
    lines = [PAGE, *_table(["fault", *heads], wide), "", "## Why", ""]
    lines += _table(["fault", "exit code", "log", "effect"], narrow)
    problems = [f"{c.fault}, {c.phase} ({c.part}): {text}" for c in cells for text in c.problems]
    again = sum(cell.tries > 1 for cell in cells)
    lines += ["", f"{len(cells)} cells, {again} of them repeated; unexpected: {len(problems)}."]
    lines += problems
    return "\n".join(lines).rstrip() + "\n"


def _alike(rows: list[list[str]]) -> list[list[str]]:
    """Rows that differ only in their fault as one row."""
    faults: dict[tuple[str, ...], list[str]] = {}
    for fault, *rest in rows:
        faults.setdefault(tuple(rest), []).append(fault)
    return [["; ".join(names), *rest] for rest, names in faults.items()]


def _table(heads: list[str], rows: list[list[str]]) -> list[str]:
    """A table in Markdown, line by line."""
    rule = "|---" * len(heads) + "|"
    return [f"| {' | '.join(heads)} |", rule, *(f"| {' | '.join(row)} |" for row in rows)]


PAGE = f"""# Faults of a station

`make test-faults` starts a station and a peer on UDP. When the station enters a phase, the test
injects a fault, such as a failing system call, and observes the peer. Every fault has an expected
outcome. The test also checks that:

- the peer does not act longer than D + `t_cam_loss` after the station left or last sent a CAM that
  names the session (T-2);
- no CAM names a session that the station has left (ACT-5);
- the station stops on request, and its log can be read.

The first table shows how the session ended for the peer, by the phase in which the fault began. It
omits faults after which every session ended with a Fin.

- *Fin*: as if nothing had failed;
- *Cancel(reason)*: by a Cancel of the station;
- *end of CAMs*: no CAM that names the session came for `t_cam_loss` (ACT-2);
- *timer (rule)*: by another timer of the peer, before it acted;
- *no session*: the station never answered or never asked.

*Time jumps* and *the host sleeps* last {JUMP_S} s. A log diverges where the fault delayed
a timer or lost a step.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, help="write the page here")
    parser.add_argument("--only", default="", help="only faults whose name has this in it")
    parser.add_argument("--jobs", type=int, default=4, help="cells at a time")
    parser.add_argument("--keep", type=Path, help="keep the logs in this new folder")
    chosen = parser.parse_args()
    faults = [fault for fault in FAULTS if chosen.only in fault]
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.keep or Path(temporary)
        folder.mkdir(exist_ok=True, parents=True)
        cells = asyncio.run(matrix(faults, chosen.jobs, folder))
    text = page(cells)
    if chosen.write:
        chosen.write.write_text(text)
    print(text)
    passed = sum(not cell.problems for cell in cells)
    print(f"{passed} passed, {len(cells) - passed} failed")
    sys.exit(passed < len(cells))


if __name__ == "__main__":
    main()
