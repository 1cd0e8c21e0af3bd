"""A stage: station 1, and the messages of the stations around it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from stateful_oracle import Coverage, Lockstep

from automcm.core.station import Effects, Station
from automcm_spec.vocabulary.application import COMMAND, Indication
from automcm_spec.vocabulary.messages import (
    Acceptance,
    Ack,
    Advertisement,
    Cam,
    Cancel,
    Fin,
    Intention,
    Message,
    MessageId,
    Prescription,
    Session,
    Trajectory,
)
from automcm_spec.vocabulary.parameters import Parameters

ME, TARGET, OTHER, PRESCRIBER = 1, 2, 3, 9
PLANNED = Trajectory(t0=0, points=((0, 0, 0), (1000, 8333, 0)))
SLOWER = Trajectory(t0=0, points=((0, 0, 0), (1000, 2778, 0)))


def advertisement(session: Session = (PRESCRIBER, 1), **more: Any) -> Advertisement:
    fields = {"src": session[0], "seq": 1, "scenario": "lane_change", "details": {}} | more
    return Advertisement(session=session, **fields)


def intention(src: int = TARGET, session: Session = (ME, 1), **more: Any) -> Intention:
    fields = {"dst": ME, "seq": 1, "planned": PLANNED} | more
    return Intention(src=src, session=session, **fields)


def prescription(
    proposal: int = 1, session: Session = (PRESCRIBER, 1), **more: Any
) -> Prescription:
    fields = {"src": session[0], "dst": ME, "seq": 1 + proposal, "prescribed": SLOWER} | more
    fields = {"hold_ms": 2000, "lease_ms": 20_000} | fields
    return Prescription(session=session, proposal=proposal, **fields)


def yes(
    proposal: int = 1, src: int = TARGET, session: Session = (ME, 1), **more: Any
) -> Acceptance:
    fields = {"dst": ME, "seq": 1 + proposal, "selected": SLOWER} | more
    return Acceptance(src=src, session=session, proposal=proposal, accepted=True, **fields)


def no(
    proposal: int = 1,
    reason: Any = "unsafe",
    src: int = TARGET,
    session: Session = (ME, 1),
    **more: Any,
) -> Acceptance:
    seq = 0 if reason in ("busy", "unknown_session") else 1 + proposal
    fields = {"dst": ME, "seq": seq} | more
    return Acceptance(
        src=src, session=session, proposal=proposal, accepted=False, reason=reason, **fields
    )


def fin(session: Session = (PRESCRIBER, 1), **more: Any) -> Fin:
    return Fin(session=session, **({"src": session[0], "dst": ME, "seq": 7} | more))


def cancel(
    reason: Any = "abort", src: int = PRESCRIBER, session: Session = (PRESCRIBER, 1), **more: Any
) -> Cancel:
    fields = {"dst": ME, "seq": 0 if reason == "closed" else 8} | more
    return Cancel(src=src, session=session, reason=reason, **fields)


def ack(of: Message, **more: Any) -> Ack:
    """The Ack that station ``of.dst`` sends for ``of``."""
    fields = {"src": of.dst, "dst": of.src, "session": of.session} | more
    return Ack(of=MessageId(type=of.type, seq=of.seq), **fields)


def cam(src: int, generation_ms: int, *marks: Session) -> Cam:
    where = {"x_mm": 0, "y_mm": 0, "heading_mrad": 0, "speed_mm_s": 8333}
    return Cam(src=src, generation_ms=generation_ms, marks=marks, **where)


def command(name: str, session: Session | None = None, **fields: Any) -> Any:
    """A command; what ``fields`` leaves out is the usual."""
    usual: dict[str, dict[str, Any]] = {
        "request": {"scenario": "lane_change", "details": {}},
        "prescribe": {
            "proposal": 1,
            "target": TARGET,
            "prescribed": SLOWER,
            "hold_ms": 2000,
            "lease_ms": 20_000,
        },
        "accept": {"proposal": 1, "selected": SLOWER},
        "refuse": {"proposal": 1},
    }
    given = usual.get(name, {}) | fields
    if session is not None:
        given["session"] = session
    return COMMAND.validate_python({"name": name} | given)


def sent(effects: Iterable[Effects], type_: str = "") -> list[Any]:
    """The messages sent, of one type if it is given."""
    return [m for e in effects for m in e.messages if type_ in ("", m.type)]


def times(effects: Iterable[Effects], type_: str) -> list[int]:
    """When messages of this type were sent."""
    return [e.now_ms for e in effects for m in e.messages if m.type == type_]


def told(effects: Iterable[Effects]) -> list[Indication]:
    return [indication for e in effects for indication in e.indications]


class Stage:
    """Station 1 with the defaults; ``do`` and ``hear`` take the time first.

    The compiled specification is beside it: whatever the station does is compared, so that a
    test says itself only what the specification leaves out.
    """

    PHASES = (
        ("none", "STANDALONE"),
        ("prescriber", "ADVERTISING"),
        ("prescriber", "CHOOSING"),
        ("prescriber", "PRESCRIBING"),
        ("prescriber", "NEGOTIATING"),
        ("prescriber", "ACTUATING"),
        ("receiver", "INTENDING"),
        ("receiver", "WAITING"),
        ("receiver", "NEGOTIATING"),
        ("receiver", "ACTUATING"),
    )

    def __init__(self, station_id: int = ME, seed: int = 0, number: int = 0, **parameters: int):
        self.station = Station(
            station_id, Parameters(**parameters), plan=lambda _: PLANNED, seed=seed, number=number
        )
        self.lockstep = Lockstep(self.station, Coverage())
        self.before = self.state
        self.own = (station_id, number + 1)
        self.now = 0

    @property
    def state(self) -> Any:
        return self.station.state

    @property
    def at(self) -> tuple[str, str]:
        return self.state.role, self.state.phase

    def deadline(self, name: str) -> int | None:
        """Of the first armed timer of this name."""
        return next((d for t, d in self.station.timers.items() if t.name == name), None)

    def took(self, effects: list[Effects]) -> list[Effects]:
        """Compare the station's step with the specification."""
        for n, effect in enumerate(effects, 1):
            self.lockstep.took(self.before, effect, n == len(effects))
            self.before = effect.state
        return effects

    def hear(self, now: int, message: Any) -> list[Effects]:
        effects, self.now = self._due_before(now), now
        return effects + self.took(self.station.receive(message, now))

    def do(
        self, now: int, name: str, session: Session | None = None, **fields: Any
    ) -> list[Effects]:
        effects, self.now = self._due_before(now), now
        return effects + self.took(self.station.command(command(name, session, **fields), now))

    def restart(self, now: int) -> list[Effects]:
        self.now = now
        return self.took(self.station.restart(now))

    def run(self, until: int) -> list[Effects]:
        effects, self.now = self._due_before(until + 1), until
        return effects + self.took(self.station.advance(until))

    def _due_before(self, now: int) -> list[Effects]:
        """Fire each timer at its deadline."""
        effects: list[Effects] = []
        while (due := self.station.next_deadline()) is not None and due < now:
            effects += self.took(self.station.advance(due))
        return effects

    def walk(self, role: str, phase: str) -> Stage:
        """Into a phase: a prescriber with stations 2 (its target) and 3, a receiver of 9."""
        steps = self._prescriber() if role == "prescriber" else self._receiver()
        while self.at != (role, phase):
            next(steps)
        return self

    def _prescriber(self) -> Iterator[None]:
        self.do(0, "request")
        yield
        self.hear(0, intention(session=self.own))
        self.hear(0, intention(OTHER, self.own))
        self.run(2100)
        yield
        (proposal,) = sent(self.do(2150, "prescribe", self.own), "Prescription")
        yield
        self.hear(2200, ack(proposal))
        yield
        self.hear(2250, yes(session=self.own))
        yield

    def _receiver(self) -> Iterator[None]:
        (mine,) = sent(self.hear(0, advertisement()))
        yield
        self.hear(10, ack(mine))
        yield
        self.hear(20, prescription())
        yield
        self.do(30, "accept", (PRESCRIBER, 1))
        yield


THEIRS = (PRESCRIBER, 1)
OWN = (ME, 1)


def names(timers: Any) -> list[str]:
    return [timer.name for timer in timers]
