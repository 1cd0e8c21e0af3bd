"""Many stations for a long time, with loss and a random fault every second.

    python conformance/tests/soak.py [--minutes 30] [--stations 20] [--loss 0.3] [--seed 1]

Some stations (every fourth) are never ended, so that their memory can be followed.  At the end:
memory and file descriptors of those are flat, every log can be read, and is allowed, or cannot
tell (it lost records), or diverges by no more than the station itself says it was late.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import resource
import signal
import socket
import statistics
import sys
import tempfile
from collections import Counter
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import typer

from automcm.encoding.codec import JSON
from automcm.links.simulated_radio import Channel
from automcm.links.udp_link import UdpLink
from automcm.service.station_process import NumberFile, StationProcess
from automcm_cli.reference.station_commands import carry_out
from automcm_simulation.radio.relay import Relay
from automcm_simulation.road.straight_lane import LANE_CHANGE, Straight
from automcm_spec.vocabulary.parameters import Parameters
from automcm_traces.explain.explain import verdict_of

PARAMETERS = Parameters(t_timeout=1000, t_cam=500)
REQUEST_EVERY_S = 20
WAITS_S = 5
SAMPLE_S = 10
SETTLED = 0.4
"""The part of the time after which memory is looked at."""
MOST_KB = 4096
"""How much more memory a station may have at the end than when it was settled."""
RUBBISH = 500


def station(station_id: int, via: str, folder: Path, seed: int, minutes: float) -> None:
    """One station: it asks for a maneuver now and then."""
    chance = random.Random(seed)
    times = [0.0]
    while times[-1] < minutes * 60:
        times.append(times[-1] + chance.expovariate(1 / REQUEST_EVERY_S) + 1)
    host, port = via.split(":")

    async def run(lines: Any) -> None:
        await StationProcess(
            station_id=station_id,
            application=Straight(maneuver_ms=chance.randrange(1000, 5000)),
            link=partial(UdpLink, via=(host, int(port))),
            codec=JSON,
            parameters=PARAMETERS,
            report=lines.report,
            complain=lines.complain,
            log=folder / f"{station_id}.ndjson",
            number_file=NumberFile(folder / f"{station_id}.number"),
            commands=[(int(at * 1000), LANE_CHANGE) for at in times[1:]],
            listen_ms=0,
        ).run()

    carry_out("station", run)


class Soak:
    """The stations, the faults, and the measurements."""

    def __init__(self, folder: Path, chosen: argparse.Namespace) -> None:
        self._folder, self._chosen = folder, chosen
        self._chance = random.Random(chosen.seed)
        self._lives: dict[int, int] = Counter()
        self._alive: dict[int, asyncio.subprocess.Process] = {}
        self._unread: set[int] = set()
        self._over = False
        self.codes: Counter[int] = Counter()
        self.done: Counter[str] = Counter()
        self.reports: Counter[str] = Counter()
        self.memory: dict[int, list[int]] = {}
        self.descriptors: dict[int, list[int]] = {}

    def _spared(self, n: int) -> bool:
        return n % 4 == 0

    async def run(self) -> None:
        relay = Relay(channel=Channel(loss=self._chosen.loss, delay_ms=(1, 20)), seed=1)
        self._via = "{}:{}".format(*relay.address)
        watch = [asyncio.create_task(self._life(n + 1)) for n in range(self._chosen.stations)]
        sampling = asyncio.create_task(self._sample())
        end = asyncio.get_running_loop().time() + self._chosen.minutes * 60
        try:
            while asyncio.get_running_loop().time() < end:
                await asyncio.sleep(1)
                if len(self._alive) == self._chosen.stations:
                    self._harm()
        finally:
            self._over = True
            sampling.cancel()
            for process in self._alive.values():
                _end(process)
            await asyncio.gather(*watch)
            relay.close()

    async def _life(self, n: int) -> None:
        """Start the station again whenever it has ended."""
        while True:
            self._lives[n] += 1
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, __file__, "--station", str(n), "--via", self._via),
                *("--folder", str(self._folder), "--seed", str(100 * n + self._lives[n])),
                *("--minutes", str(self._chosen.minutes)),
                stdout=asyncio.subprocess.PIPE,
                stderr=open(self._folder / "stderr", "ab"),  # noqa: SIM115
            )
            self._alive[n] = process
            if self._over:  # meanwhile
                _end(process)
            assert process.stdout is not None
            while line := await process.stdout.readline():
                self.reports[json.loads(line).get("rule", "")] += 1
                while n in self._unread:
                    await asyncio.sleep(0.1)
            self.codes[await process.wait()] += 1
            del self._alive[n]
            if self._over:
                return

    def _harm(self) -> None:
        """A random fault, for a random station."""
        loop = asyncio.get_running_loop()
        n = self._chance.choice(sorted(self._alive))
        process = self._alive[n]
        ending = [] if self._spared(n) else ["SIGTERM", "SIGKILL"]
        what = self._chance.choice(["SIGSTOP", "full", "unread", "rubbish", "forged", *ending])
        self.done[what] += 1
        match what:
            case "SIGSTOP":
                _kill(process, signal.SIGSTOP)
                for_s = self._chance.uniform(0.05, 3)
                loop.call_later(for_s, partial(_kill, process, signal.SIGCONT))
            case "full":
                hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
                _room(process, (1, hard))
                for_s = self._chance.uniform(0, WAITS_S)
                loop.call_later(for_s, partial(_room, process, (hard, hard)))
            case "unread":
                self._unread.add(n)
                loop.call_later(self._chance.uniform(0, WAITS_S), self._unread.discard, n)
            case "rubbish" | "forged":
                self._send(what)
            case name:
                _kill(process, signal.Signals[name])

    def _send(self, what: str) -> None:
        host, port = self._via.split(":")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            for _ in range(RUBBISH):
                data = self._chance.randbytes(self._chance.randrange(200))
                if what == "forged":
                    src, dst = self._chance.sample(range(1, self._chosen.stations + 1), 2)
                    ack = {"type": "Intention", "seq": self._chance.randrange(9)}
                    fields = {"v": 1, "type": "Ack", "src": src, "dst": dst, "seq": 0, "of": ack}
                    fields["session"] = [dst, self._chance.randrange(1, 50)]
                    data = json.dumps(fields).encode()
                sock.sendto(data, (host, int(port)))

    async def _sample(self) -> None:
        while True:
            await asyncio.sleep(SAMPLE_S)
            for n, process in self._alive.items():
                if self._spared(n):  # it is ended by nobody
                    status = Path(f"/proc/{process.pid}/status").read_text()
                    kb = int(status.split("VmRSS:")[1].split()[0])
                    self.memory.setdefault(n, []).append(kb)
                    count = len(os.listdir(f"/proc/{process.pid}/fd"))
                    self.descriptors.setdefault(n, []).append(count)

    def judge(self) -> list[str]:
        """What is not as it must be."""
        problems, growth = [], []
        for n, values in sorted(self.memory.items()):
            settled = values[int(len(values) * SETTLED) :]
            quarter = max(1, len(settled) // 4)
            first, last = (
                statistics.median(part) for part in (settled[:quarter], settled[-quarter:])
            )
            growth.append(last - first)
            if last - first > MOST_KB:
                problems.append(f"station {n}: {first:.0f} kB became {last:.0f} kB")
            counts = self.descriptors[n]
            if counts[-1] > counts[0]:
                problems.append(f"station {n}: {counts[0]} descriptors became {counts[-1]}")
        verdicts: Counter[str] = Counter()
        events = 0
        for path in sorted(self._folder.glob("*.ndjson")):
            with path.open("rb") as file:
                late = [int(line.split(b'"late_ms":')[1].split(b",")[0]) for line in file
                        if b'"late_ms":' in line]  # fmt: skip
            verdict = verdict_of(path, max([50, *late]))
            verdicts[verdict.verdict] += 1
            events += verdict.events
            if verdict.verdict in ("diverges", "unreadable"):
                problems.append(
                    f"{path.name}:{verdict.finding.at.line}: {verdict.verdict}: "
                    f"{verdict.finding.observed}"
                )
        odd = {code: n for code, n in self.codes.items() if code not in (0, 3, -signal.SIGKILL)}
        problems += [f"{n} processes ended with {code}" for code, n in odd.items()]
        print(f"faults: {dict(sorted(self.done.items()))}")
        print(f"exit codes: {dict(sorted(self.codes.items()))}; lives: {sum(self._lives.values())}")
        rules = {rule: self.reports[rule] for rule in ("NEG-6", "ACT-3", "ACT-2", "END-1")}
        print(f"steps reported: {rules}")
        print(f"logs: {dict(verdicts)}, {events:,} events")
        print(f"memory: largest growth {max(growth, default=0):.0f} kB; descriptors flat"
              if not problems else "memory: see below")  # fmt: skip
        return problems


def _end(process: asyncio.subprocess.Process) -> None:
    _kill(process, signal.SIGCONT)
    _kill(process, signal.SIGTERM)


def _kill(process: asyncio.subprocess.Process, signum: int) -> None:
    with suppress(ProcessLookupError):  # killed, and we have not been told yet
        os.kill(process.pid, signum)


def _room(process: asyncio.subprocess.Process, limit: tuple[int, int]) -> None:
    with suppress(ProcessLookupError):
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, limit)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=30)
    parser.add_argument("--stations", type=int, default=20)
    parser.add_argument("--loss", type=float, default=0.3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="keep the logs in this new folder")
    parser.add_argument("--station", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--via", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.station:
        try:
            station(chosen.station, chosen.via, chosen.folder, chosen.seed, chosen.minutes)
        except typer.Exit as end:
            sys.exit(end.exit_code)
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        soak = Soak(folder, chosen)
        asyncio.run(soak.run())
        problems = soak.judge()
    for problem in problems:
        print(problem)
    print(f"{chosen.minutes:g} minutes, {chosen.stations} stations: {len(problems)} problems")
    sys.exit(bool(problems))


if __name__ == "__main__":
    main()
