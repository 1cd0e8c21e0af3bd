"""One fault in one phase: the station with the fault, a peer, and the peer's observations."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fault_reasons import WHY, Why

from automcm.core.outcome import Received, ReceivedCam
from automcm.core.state import State
from automcm.core.station import Effects
from automcm.links.clock import AsyncioClock
from automcm.links.udp_link import BROADCAST_HOST, UdpLink
from automcm.service.service import McService
from automcm_simulation.road.straight_lane import LANE_CHANGE, Straight
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.explain.explain import verdict_of

HERE = Path(__file__).parent
SETTINGS = {"t_timeout": 300, "t_resend": 50, "t_cam_loss": 1100, "t_decide": 300}
LATE_MS = 150
"""How late a timer or a CAM of a process on a busy machine may be."""
MANEUVER_MS = 2000
ENDING_S = 4
CAMS_S = 0.5
"""How long CAMs are looked at after the session."""
LIMIT_S = 14


@dataclass
class Cell:
    """One fault in one phase, and its result."""

    fault: str
    role: str
    phase: str
    part: str
    folder: Path
    port: int
    truth: list[dict[str, Any]] = field(default_factory=list)
    marked: list[tuple[float, tuple[tuple[int, int], ...]]] = field(default_factory=list)
    """The time at which a CAM of the station arrived, and its marks."""
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
        """The whole cell; ``problems`` describes its failures."""
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
        if isinstance(effects.input, ReceivedCam) and effects.input.message.src == 1:
            self.marked.append((now, effects.input.message.marks))
        if before.phase != effects.state.phase:
            reason = ""
            if isinstance(effects.input, Received):
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
        """ACT-5 and T-2: no CAM names a session that was left, and the peer stops acting."""
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
        verdict = verdict_of(log, max(LATE_MS, *late))  # it says itself when it was late
        self.verdict = verdict.verdict
        if self.verdict == "unreadable" or (self.verdict == "diverges" and not why.diverges):
            self.problems.append(
                f"log {self.verdict}: line {verdict.finding.at.line}: {verdict.finding.observed}"
            )
