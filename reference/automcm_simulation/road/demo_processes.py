"""``automcm demo``: the four vehicles of the paper's Fig. 6 as four processes over UDP.

A relay between them loses and delays datagrams.  The demonstration ends when no station is in a
session and none has a message left to send.  Its outcome is then compared with the expected one,
and every station's log is checked against the oracle.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from automcm.links.simulated_radio import Channel
from automcm.service.station_process import stopping
from automcm_simulation.radio.relay import Relay
from automcm_spec.support import children, files, scratch
from automcm_spec.support.bad_input import BadInput
from automcm_traces.explain.explain import Verdict, verdicts_of
from automcm_traces.viewer.page import html
from automcm_traces.viewer.page_data import load
from automcm_traces.viewer.page_part import PageError

LIMIT_S = 50
ENDING_S = 5
LATE_MS = 500
"""Tolerated delay of a timer in the log of a process on a busy machine."""
KILL_AFTER_MS = 300
VALID_S = 86_400
PLACES_M = ((0, 0), (24, 3.5), (0, 3.5), (-26, 3.5), (40, 0))
"""Where the vehicles are at the start, in m along and across the road: the prescriber wants the
lane in which A, B and C drive."""


@dataclass
class DemoVehicle:
    """One process and its reports."""

    name: str
    station_id: int
    options: list[str] = field(default_factory=list)
    phase: str = "STANDALONE"
    role: str = "none"
    session: list[int] | None = None
    sending: int = 0
    sent: Counter[str] = field(default_factory=Counter)
    received: Counter[str] = field(default_factory=Counter)
    way: list[str] = field(default_factory=list)
    """Phases, each with the rule of its transition."""
    indications: list[str] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)
    """The reasons of the refusing Acceptances that it sent."""
    latest_ms: int = 0
    certificate: str | None = None
    """The digest of the certificate with which it signs."""
    killed: bool = False
    ended: bool = False
    """It has reported its end."""
    error: str = ""
    process: asyncio.subprocess.Process | None = None

    def take(self, event: dict[str, Any]) -> None:
        """Apply an event that its process has reported."""
        self.phase, self.role = event["phase"], event["role"]
        self.session, self.sending = event["session"], event["sending"]
        match event["event"]:
            case "sent":
                self.sent[event["type"]] += 1
                if event["type"] == "Acceptance" and event["reason"]:
                    self.refusals.append(event["reason"])
            case "received":
                self.received[event["type"]] += 1
            case "phase":
                self.way.append(f"{event['phase']} {event['rule']}")
            case "told":
                reason = f"({event['reason']})" if event["reason"] else ""
                self.indications.append(event["name"] + reason)
            case "start":
                self.certificate = event.get("certificate")
            case "end":
                self.ended = True
                self.latest_ms = event["statistics"]["latest_ms"]

    @property
    def idle(self) -> bool:
        """It has left its session and has no message left to send."""
        return self.killed or (bool(self.way) and self.phase == "STANDALONE" and not self.sending)

    def went(self, *steps: str) -> bool:
        """Whether its phases contain these steps in this order, possibly with others between."""
        rest = iter(self.way)
        return all(step in rest for step in steps)


@dataclass
class Demo:
    """One demonstration.  ``changed`` is called after each event."""

    folder: Path
    loss: float = 0.0
    delay_ms: tuple[int, int] = (2, 20)
    kill: bool = False
    second_prescriber: bool = False
    secured: bool = False
    close_early: bool = False
    seed: int = 0
    listen_ms: int = 1100
    changed: Callable[[Demo], None] = lambda demo: None
    vehicles: list[DemoVehicle] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    delivered: int = 0
    lost: int = 0
    seconds: float = 0.0
    page: Path | None = None
    """The page of the run, once written."""

    def __post_init__(self) -> None:
        impatient = ["--set", "t_timeout=500"] if self.second_prescriber else []
        asks = "1500" if self.second_prescriber else "500"
        aside = ["--no-concerned", "--target", "3"]
        aside += ["--close-early"] if self.close_early else []
        self.vehicles = [
            DemoVehicle("prescriber", 1, ["--request-after", asks, "--maneuver", "4000", *aside]),
            *(DemoVehicle(name, n, list(impatient)) for n, name in enumerate("ABC", 2)),
        ]
        if self.second_prescriber:
            asks_long = ["--request-after", "1", "--set", "t_timeout=4000"]
            self.vehicles.append(DemoVehicle("second prescriber", 5, asks_long + aside))

        for vehicle, (along, across) in zip(self.vehicles, PLACES_M, strict=False):
            vehicle.options += ["--name", vehicle.name, "--place", f"{along},{across}"]

    def vehicle(self, name: str) -> DemoVehicle:
        """The vehicle with this name."""
        return next(vehicle for vehicle in self.vehicles if vehicle.name == name)

    @property
    def logs(self) -> list[Path]:
        """The log of each station."""
        return [self.folder / f"{vehicle.station_id}.ndjson" for vehicle in self.vehicles]

    async def run(self) -> None:
        """Run it.  Raises LinkError, OSError or MissingExtra if it cannot be started."""
        with scratch.folder("keys") if self.secured else nullcontext() as keys:
            if keys is not None:
                self._issue(keys)
            await self._run()

    def _issue(self, folder: Path) -> None:
        """Give every vehicle a certificate, valid from 0 on its clock (``--zero``)."""
        from automcm.service.authority_folder import AuthorityFolder

        authority = AuthorityFolder.create(folder / "authority")
        for vehicle in self.vehicles:
            own = folder / str(vehicle.station_id)
            authority.issue(own, ids=[vehicle.station_id], not_before=0, not_after=VALID_S)
            vehicle.options += ["--keys", str(own)]

    async def _run(self) -> None:
        files.folder(self.folder, named=True)
        for old in (*self.folder.glob("[1-5].ndjson"), self.folder / "page.html"):
            old.unlink(missing_ok=True)
        began = time.monotonic()
        stopped = stopping(LIMIT_S * 1000)
        relay = Relay(channel=Channel(loss=self.loss, delay_ms=self.delay_ms), seed=self.seed)
        over = asyncio.create_task(self._over())
        readers: list[asyncio.Task[None]] = []
        try:
            for vehicle, log in zip(self.vehicles, self.logs, strict=True):
                if not stopped.done():
                    await self._start(vehicle, log, relay, began)
                    readers.append(asyncio.create_task(self._read(vehicle)))
            waiting = {over, stopped, *readers}
            await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            while not (over.done() or stopped.done() or any(v.error for v in self.vehicles)):
                await asyncio.sleep(0.05)
            if stopped.done():
                self.problems.append(f"stopped by a signal, or not finished after {LIMIT_S} s")
        finally:
            self._ending = True
            over.cancel()
            await self._stop(readers)
            relay.close()
        self.delivered, self.lost = relay.radio.delivered, relay.radio.lost
        self.seconds = time.monotonic() - began
        self._judge()

    _ending = False

    async def _start(self, vehicle: DemoVehicle, log: Path, relay: Relay, began: float) -> None:
        host, port = relay.address
        command = [
            *(sys.executable, "-P", "-m", "automcm_cli", "station", "--first"),
            *("--id", str(vehicle.station_id), "--via", f"{host}:{port}"),
            *("--listen", str(self.listen_ms), "--zero", str(began), "--log", str(log)),
            *("--for", str(2 * LIMIT_S * 1000)),
            *vehicle.options,
        ]
        vehicle.process = await asyncio.create_subprocess_exec(
            *children.ending_with_parent(command),
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )

    async def _read(self, vehicle: DemoVehicle) -> None:
        """Take the reports of one process until it ends."""
        process = vehicle.process
        assert process is not None and process.stdout is not None and process.stderr is not None
        async for line in process.stdout:
            try:
                report = json.loads(line)
            except ValueError:
                vehicle.error = (
                    f"{vehicle.name}: expected a report in JSON, not "
                    f"{line[:200].decode(errors='replace')}"
                )
                process.kill()
            else:
                vehicle.take(report)
            self.changed(self)
        errors = (await process.stderr.read()).decode(errors="replace").strip()
        code = await process.wait()
        if vehicle.killed or vehicle.error:
            return
        if code != 0 or not vehicle.ended:
            last = errors.splitlines()[-1] if errors else f"exit code {code}"
            vehicle.error = f"{vehicle.name}: {last}"
        elif not self._ending:
            vehicle.error = f"{vehicle.name}: ended before SIGTERM"

    async def _over(self) -> None:
        """Wait until all vehicles are idle; kill B during the maneuver if requested."""
        prescriber, b = self.vehicle("prescriber"), self.vehicle("B")
        while not all(vehicle.idle for vehicle in self.vehicles):
            await asyncio.sleep(0.05)
            if self.kill and not b.killed and prescriber.phase == b.phase == "ACTUATING":
                await asyncio.sleep(KILL_AFTER_MS / 1000)
                assert b.process is not None
                b.killed = True
                b.process.kill()

    async def _stop(self, readers: Sequence[asyncio.Task[None]]) -> None:
        """Terminate all processes; kill those that do not end."""
        alive = [v for v in self.vehicles if v.process and v.process.returncode is None]
        for vehicle in alive:
            assert vehicle.process is not None
            vehicle.process.terminate()
        if readers:
            await asyncio.wait(readers, timeout=ENDING_S)
        for vehicle in alive:
            assert vehicle.process is not None
            if vehicle.process.returncode is None:
                vehicle.error = vehicle.error or f"{vehicle.name}: did not end after SIGTERM"
                vehicle.process.kill()
                await vehicle.process.wait()

    def _judge(self) -> None:
        """Collect the differences from the description and the oracle's findings."""
        self.problems += [vehicle.error for vehicle in self.vehicles if vehicle.error]
        for what, so in self._described():
            if not so:
                self.problems.append(f"not as described: {what}")
        self.verdicts = verdicts_of(self.logs, LATE_MS)
        for vehicle, verdict in zip(self.vehicles, self.verdicts, strict=True):
            if verdict.verdict != "allowed":
                where = f"{verdict.file}:{verdict.finding.at.line}"
                self.problems.append(f"{where}: {verdict.verdict} at {verdict.finding.observed}")
            if not vehicle.killed:
                self.problems += [f"{verdict.file}: {warning}" for warning in verdict.warnings]

    def write_page(self) -> None:
        """Write the page of the run beside the logs.  Raises OSError."""
        try:
            data = html(load(self.logs, "automcm demo", LATE_MS))
        except (BadInput, PageError):
            return  # no station has written its log; the problems say why
        files.write(self.folder / "page.html", data)
        self.page = self.folder / "page.html"

    def _described(self) -> Sequence[tuple[str, bool]]:
        prescriber, a, b, c = self.vehicles[:4]
        signed = all(v.certificate for v in self.vehicles)
        closed = "CHOOSING ADV-9" if self.close_early else "CHOOSING PRE-1"
        acted = prescriber.went("ADVERTISING ADV-1", closed, "ACTUATING NEG-6")
        agreed = [
            ("all vehicles sign their messages", signed or not self.secured),
            ("the prescriber advertises, chooses, and acts after B's Acceptance", acted),
            ("B accepts", b.went("NEGOTIATING NEG-1", "ACTUATING NEG-2")),
            *(
                (f"{v.name} gets the indication {NOT_SELECTED}", NOT_SELECTED in v.indications)
                for v in (a, c)
            ),
        ]
        if self.kill:
            fell_back = "fallback(cam_loss)" in prescriber.indications
            return [*agreed, ("the prescriber falls back because of CAM loss (ACT-2)", fell_back)]
        finished = [
            ("the prescriber ends with Fin (ACT-3)", prescriber.went("ACTUATING NEG-6", FIN)),
            ("B gets the indication finished", "finished" in b.indications),
        ]
        if not self.second_prescriber:
            return agreed + finished
        second = self.vehicles[4]
        refused = [
            ("B refuses the second prescriber as busy (NEG-4)", "busy" in b.refusals),
            ("the second prescriber gives up", "fallback(no_agreement)" in second.indications),
        ]
        return agreed + finished + refused

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "ok": not self.problems,
            "problems": self.problems,
            "seconds": round(self.seconds, 1),
            "page": str(self.page) if self.page else None,
            "delivered": self.delivered,
            "lost": self.lost,
            "vehicles": [
                {
                    "name": v.name,
                    "station": v.station_id,
                    "phases": v.way,
                    "told": v.indications,
                    "refusals": v.refusals,
                    "sent": dict(v.sent),
                    "received": dict(v.received),
                    "latest_ms": v.latest_ms,
                    "killed": v.killed,
                }
                for v in self.vehicles
            ],
            "logs": [verdict.as_dict() for verdict in self.verdicts],
        }


NOT_SELECTED = "fallback(not_selected)"
FIN = "STANDALONE ACT-3"
