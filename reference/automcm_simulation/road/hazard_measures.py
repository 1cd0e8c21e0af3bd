"""Hazards in a simulation, measured from the states of its services (S-5, T-2).

In a hazard, a prescriber is in ACTUATING while its target is not committed to that session and
proposal.  S-5 excuses it only if the target itself aborted, lost CAMs, restarted or crashed in
that session.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from automcm.core.outcome import Expiry, Restart
from automcm.core.state import State
from automcm.core.station import Effects
from automcm.links.simulated_radio import Channel
from automcm.service.service import McService, Observer
from automcm_simulation.road.simulation import Simulation
from automcm_spec.vocabulary.application import Abort, Accepted, Complete, Finished
from automcm_spec.vocabulary.messages import Session
from automcm_spec.vocabulary.parameters import Parameters

EXCUSES = ("abort", "cam_loss", "restart", "crash")
"""The possible excuses by the target (S-5)."""


def bound_ms(parameters: Parameters, delay_ms: int) -> int:
    """B = D + L, the longest that an excused hazard lasts (theorem T-2, docs/verification.md,
    section 4): the longest delay of a copy and ``t_cam_loss``, in ms.

    It assumes 2 · D < ``t_resend``, that the CAM interval plus D is below L, and a lease of at
    least L.  Raises ValueError for a delay or a CAM interval outside of these assumptions.
    """
    if not 0 <= 2 * delay_ms < parameters.t_resend:
        raise ValueError(f"delay_ms must be below half of t_resend, not {delay_ms} ms")
    if not delay_ms < parameters.t_cam:
        raise ValueError(
            f"t_cam must be above the delay of {delay_ms} ms, not {parameters.t_cam} ms"
        )
    if not parameters.t_cam + delay_ms < parameters.t_cam_loss:
        raise ValueError("t_cam_loss must be above the sum of the CAM interval and the delay")
    return delay_ms + parameters.t_cam_loss


@dataclass(frozen=True, slots=True)
class MeasuredHazard:
    """``excuse`` is one of EXCUSES; if it is empty, S-5 does not hold."""

    session: Session
    since_ms: int
    until_ms: int
    excuse: str

    @property
    def length_ms(self) -> int:
        """Its duration in ms."""
        return self.until_ms - self.since_ms


def met(seeds: Sequence[int], runs: Sequence[Sequence[MeasuredHazard]], b: int) -> dict[str, Any]:
    """The hazards of runs with these seeds: their sorted ``lengths`` in ms by excuse (or ``none``),
    and the first that are ``wrong``: unexcused, or longer than ``b``."""
    lengths: dict[str, list[int]] = {}
    for hazard in (hazard for run in runs for hazard in run):
        lengths.setdefault(hazard.excuse or "none", []).append(hazard.length_ms)
    wrong = [
        {"seed": seed, "ms": h.length_ms, "excuse": h.excuse}
        for seed, run in zip(seeds, runs, strict=True)
        for h in run
        if is_wrong(h.excuse or "none", h.length_ms, b)
    ]
    return {
        "bound_ms": b,
        "lengths": {excuse: sorted(each) for excuse, each in lengths.items()},
        "with_hazard": sum(bool(run) for run in runs),
        "wrong": wrong[:5],
    }


def is_wrong(excuse: str, ms: int, b: int) -> bool:
    """Whether a hazard is unexcused (S-5) or longer than its bound (T-2)."""
    return excuse == "none" or ms > b


def number_wrong(hazards: Mapping[str, Any]) -> int:
    """How many hazards of ``met`` are wrong."""
    lengths, b = hazards["lengths"], hazards["bound_ms"]
    return sum(is_wrong(excuse, ms, b) for excuse, each in lengths.items() for ms in each)


class Watched(Simulation):
    """A simulation that records hazards and the outcome of each session.

    A hazard that begins and ends in one millisecond does not count.
    """

    def __init__(
        self,
        *,
        seed: int = 0,
        channel: Channel | None = None,
        logs: Path | None = None,
        service: Callable[..., McService] = McService,
    ) -> None:
        super().__init__(seed=seed, channel=channel, logs=logs, service=service)
        self.hazards: list[MeasuredHazard] = []
        """The finished hazards, in the order of their ends."""
        self.agreed: set[Session] = set()
        """Sessions in which the prescriber got the indication accepted."""
        self.completed: set[Session] = set()
        """Sessions that the prescriber ended with its Fin."""
        self.finished: set[Session] = set()
        """Sessions in which the target got the indication finished."""
        self.down: set[int] = set()
        """Crashed stations."""
        self._since: dict[Session, tuple[int, int]] = {}
        """The begin of each present hazard, and the station without commitment."""
        self._excuses: dict[tuple[Session, int], str] = {}

    def watching(self, station_id: int) -> tuple[Observer, ...]:
        """As in Simulation."""
        return (partial(self._note, station_id),)

    def crash(self, station_id: int) -> None:
        """Stop the service at once; the vehicle drives on alone."""
        service = self.services[station_id]
        session = service.state.session
        self._excuse(station_id, service.state, "crash")
        self.down.add(station_id)
        service.close()
        if session is not None:
            service.application.fallback(session, "crash")
        self._look()

    def recover(self, station_id: int) -> None:
        """Restart a crashed service (END-8)."""
        self.down.discard(station_id)
        self.services[station_id].start()
        self.services[station_id].restart()

    def committed(self, station_id: int) -> bool:
        """Whether a station runs and is committed to a prescriber."""
        st = self.services[station_id].state
        return station_id not in self.down and (st.role, st.phase) == ("receiver", "ACTUATING")

    @property
    def idle(self) -> bool:
        """Whether no running station is in a session or still repeats a message."""
        states = (s.state for n, s in self.services.items() if n not in self.down)
        return not any(st.bound or st.outbox for st in states)

    def over(self) -> list[MeasuredHazard]:
        """All hazards; an unfinished one ends now."""
        return self.hazards + [self._hazard(session) for session in self._since]

    def _note(self, station_id: int, before: State, effects: Effects) -> None:
        i = effects.input
        if isinstance(i, Restart):
            self._excuse(station_id, before, "restart")
        elif isinstance(i, Abort) and effects.rule == "END-1":
            self._excuse(station_id, before, "abort")
        elif isinstance(i, Expiry) and i.timer.name == "cam":
            self._excuse(station_id, before, "cam_loss")
        elif isinstance(i, Complete) and effects.rule == "ACT-3":
            self.completed.add(i.session)
        for indication in effects.indications:
            if isinstance(indication, Accepted):
                self.agreed.add(indication.session)
            elif isinstance(indication, Finished):
                self.finished.add(indication.session)
        if effects.state is not before:
            self._look()

    def _excuse(self, station_id: int, st: State, what: str) -> None:
        if st.role == "receiver" and st.session is not None:
            self._excuses.setdefault((st.session, station_id), what)

    def _look(self) -> None:
        """Update the present hazards."""
        now = self.clock.now()
        there = set()
        for station_id, service in self.services.items():
            st = service.state
            acts = (st.role, st.phase) == ("prescriber", "ACTUATING")
            if acts and station_id not in self.down and not self._keeps_to(st):
                assert st.session is not None
                there.add(st.session)
                self._since.setdefault(st.session, (now, st.target))
        for session in [session for session in self._since if session not in there]:
            hazard = self._hazard(session)
            del self._since[session]
            if hazard.length_ms:
                self.hazards.append(hazard)

    def _keeps_to(self, st: State) -> bool:
        """Whether the target is committed to the proposal of a prescriber in this state."""
        peer = self.services[st.target].state
        same = (peer.session, peer.proposal) == (st.session, st.proposal)
        return same and self.committed(st.target)

    def _hazard(self, session: Session) -> MeasuredHazard:
        since, target = self._since[session]
        excuse = self._excuses.get((session, target), "")
        return MeasuredHazard(session, since, self.clock.now(), excuse)
