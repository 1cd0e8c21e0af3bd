"""The cases for a live station and their verdicts (live.py; docs/conformance.md).

Each case is a script (scripts.py) for a receiver in natural time.  A timing fault is confirmed
by the same script with an adapter, in virtual time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.adapter.protocol import Object
from automcm_conformance.exchange.exchange import Broken, Exchange, Infeasible, Mismatch
from automcm_conformance.exchange.results import Line, Verdict
from automcm_conformance.exchange.wire import ME, STRANGER, Values
from automcm_conformance.live.live import Failed, Live, UdpAir, Unwritten, said_by
from automcm_conformance.suite import scripted
from automcm_conformance.suite import scripts as s
from automcm_spec.graph.oracle import Oracle
from automcm_spec.vocabulary.station import Expire

LEASE_MS = 20_000
STATIONS = 10
"""The kit uses at most this many station ids in one case."""


@dataclass(frozen=True, slots=True)
class LiveCase:
    """A case; at the end of ``script`` the session has ended and the outbox is empty."""

    name: str
    rules: tuple[str, ...]
    then: str
    script: s.Script
    lease_ms: int = LEASE_MS


def _resent(*entry: Any) -> Expire:
    return s.expire("resend", s.entry(*entry))


_INTENTION = "Intention", s.Y, s.THEIRS
_ACCEPTANCE = "Acceptance", s.Y, s.THEIRS, 1, True
_OTHER = s.received("Advertisement", s.NEXT)
_ACTUATING: s.Script = [*s.COMMITTED, s.ACCEPTANCE_ACKED]
_FREE = s.expire("forget", s.Y), s.expire("quarantine")
"""The receiver broke its commitment, so the next case begins when it may join again (ACT-6)."""
_LATER = s.Wait(400), s.HEARD_THEM
_HEARD = s.ACCEPTANCE_ACKED, s.Wait(200), s.HEARD_THEM, s.Wait(200)
_ENDED = _resent("Cancel", s.Y, s.THEIRS), s.received("Ack", s.THEIRS, of=("Cancel", 1))

CASES = (
    LiveCase(
        "intention",
        ("ADV-3", "REL-1", "ADV-6", "END-2"),
        "it sends its Intention at once and every t_resend until the Ack; it acks the Cancel",
        [s.ADVERTISED, *[_resent(*_INTENTION)] * 3, s.INTENTION_ACKED, s.Wait(250), s.CANCELLED],
    ),
    LiveCase(
        "given up",
        ("ADV-6", "REL-1"),
        "without an Ack it sends its Intention until t_timeout and no longer",
        [s.ADVERTISED, s.expire("giveup", s.entry(*_INTENTION)), s.Wait(300), s.CANCELLED],
    ),
    LiveCase(
        "agreement",
        ("NEG-1", "NEG-2", "REL-1", "ACT-3"),
        "it acks each Prescription, sends its Acceptance until the Ack, and acks each Fin",
        [*s.COMMITTED, _resent(*_ACCEPTANCE), s.INSTRUCTED, *_HEARD, s.FINISHED, s.FINISHED],
    ),
    LiveCase(
        "busy",
        ("NEG-4", "ADV-4"),
        "it refuses a Prescription of another session as busy, and ignores its Advertisement",
        [*s.WAITING, _OTHER, s.received("Prescription", s.NEXT), s.Wait(150), s.CANCELLED],
    ),
    LiveCase(
        "unknown session",
        ("NEG-5", "END-3"),
        "it refuses a Prescription of an unknown session, and acks its Cancel and Fin",
        [s.INSTRUCTED, s.INSTRUCTED, s.CANCELLED, s.FINISHED],
    ),
    LiveCase(
        "cancel",
        ("END-2", "END-3", "ADV-8"),
        "it acks each Cancel, stops sending its Acceptance, and does not join the session again",
        [*s.COMMITTED, s.CANCELLED, s.CANCELLED, s.ADVERTISED, s.Wait(150)],
    ),
    LiveCase(
        "cam loss",
        ("ACT-2", "REL-1", "END-6"),
        "from t_cam_loss after the last CAM it sends a Cancel (cam_loss) until the Ack",
        [*_ACTUATING, s.HEARD_THEM, *_LATER, s.expire("cam"), *_ENDED, *_FREE],
    ),
    LiveCase(
        "lease",
        ("ACT-4", "REL-1", "END-6"),
        "from the end of the lease it sends a Cancel (lease_expired) until the Ack",
        [*_ACTUATING, *_LATER, *_LATER, *_LATER, s.expire("lease"), *_ENDED, *_FREE],
        lease_ms=1_900,
    ),
)


@dataclass(frozen=True, slots=True)
class LiveResult:
    """The verdict on one case; ``reason`` is empty for PASS."""

    case: str
    rules: tuple[str, ...]
    then: str
    verdict: Verdict
    reason: str = ""
    lines: list[Line] = field(default_factory=list)


@dataclass(slots=True)
class LiveRun:
    """A run against one station.

    ``parameters`` are those of the station.  ``number`` must be greater than in all earlier runs:
    sessions and the ids of peers are numbered from it, because the station may remember positions
    of peers and sessions it has joined.
    """

    oracle: Oracle
    air: UdpAir
    station: int
    parameters: Mapping[str, int]
    jitter_ms: int
    number: int
    scenario: str = "lane_change"
    adapter: Adapter | None = None
    """An adapter of the same implementation, for the cases in virtual time."""
    results: list[LiveResult] = field(default_factory=list)
    known: list[Object] = field(default_factory=list)
    """The messages that the station had to send."""
    unsettled: set[int] = field(default_factory=set)
    """Peers of cases that did not pass; the station may still be sending to them."""
    stuck: Live | None = None
    """The case after which the station did not become idle."""

    @property
    def exit_code(self) -> int:
        """1 if a case failed, 4 if one was inconclusive, else 0."""
        verdicts = {judged.verdict for judged in self.results}
        return 1 if "FAIL" in verdicts else 4 if "INCONC" in verdicts else 0

    def as_dict(self) -> dict[str, object]:
        """The report as a JSON object."""
        return {
            "format": "automcm.live/1",
            "station": self.station,
            "jitter_ms": self.jitter_ms,
            "parameters": dict(self.parameters),
            "exit_code": self.exit_code,
            "cases": [asdict(judged) for judged in self.results],
        }

    def heard(self, limit_ms: int) -> bool:
        """Whether the station sends a CAM within ``limit_ms``."""
        until = self.air.now() + limit_ms
        while (received := self.air.receive(until)) is not None:
            m = said_by(self.station, received[1])
            if m is not None and m.get("type") == "CAM":
                return True
        return False

    def judge(self, case: LiveCase) -> LiveResult:
        """Play a case, and wait until the station is idle again."""
        lines: list[Line] = []
        verdict, reason = self._played(case, lines)
        self.results.append(LiveResult(case.name, case.rules, case.then, verdict, reason, lines))
        return self.results[-1]

    def _played(self, case: LiveCase, lines: list[Line]) -> tuple[Verdict, str]:
        if self.stuck is not None and not self._settled(self.stuck):
            return "INCONC", "the station did not become idle after the previous case"
        x = self._exchange()
        live = Live(x, self.air, self.jitter_ms, lines, self.known, self.unsettled)
        try:
            live.play(case.script, case.lease_ms)
        except Failed as failed:
            verdict: Verdict = "FAIL" if failed.kind == "unexpected" else "INCONC"
            reason = str(failed)
            if failed.kind == "overdue":
                verdict, reason = self._timing(case, reason)
            self.unsettled.update(x.wire.values.ids.values())
            self.stuck = None if self._settled(live) else live
            return verdict, reason
        return "PASS", ""

    def _settled(self, live: Live) -> bool:
        """Whether the station has become idle."""
        p = self.parameters
        quiet = 2 * (p["t_resend"] + self.jitter_ms)
        return live.settle(quiet, 3 * (p["t_timeout"] + p["t_resend"]) + quiet)

    def _timing(self, case: LiveCase, missed: str) -> tuple[Verdict, str]:
        """The verdict on a timing fault: FAIL only if the case also fails in virtual time."""
        if self.adapter is None:
            return "INCONC", missed
        found = self.in_virtual_time(self.adapter, case)
        if found is None:
            return "INCONC", f"{missed}; the case cannot be judged in virtual time"
        if not found:
            return "INCONC", f"{missed}; the case passes in virtual time"
        return "FAIL", f"{missed}; the case fails in virtual time too: {found}"

    def in_virtual_time(self, adapter: Adapter, case: LiveCase) -> str | None:
        """The failure of a case with an adapter; empty if it passes, None if that cannot be
        decided."""
        hello = adapter.hello
        given = hello.fitted(self.parameters)
        x = Exchange(self.oracle, adapter, given, scenario=hello.scenarios[0])
        try:
            scripted.play(x, case.script, case.lease_ms)
        except Mismatch as wrong:
            adapter.renew()
            return str(wrong)
        except (Broken, Infeasible):
            adapter.renew()
            return None
        return ""

    def _exchange(self) -> Exchange:
        """An exchange with peers and sessions that are new to the station."""
        first = 3 * 10**9 if self.station < 2 * 10**9 else 10**9
        first += STATIONS * (self.number % 10**7 * 10 + len(self.results))
        ids = {n: first + n for n in (2, 3, STRANGER)}
        sessions = (0, self.number, self.number + 1)
        values = Values(
            {0: 0, ME: self.station, **ids},
            dict.fromkeys((2, 3, STRANGER), sessions),
            start_ms=self.air.now(),
        )
        return Exchange(
            self.oracle,
            Unwritten(),
            self.parameters,
            scenario=self.scenario,
            values=values,
            predict=True,
            logged=False,
        )
