"""The reference's answers at each state of a graph: all that can be observed of it.

This module is only imported after the reference has been replaced (mutated_process.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

from automcm.core.state import State, Timer, armed
from automcm.core.station import Effects, Station
from automcm_maintenance.code_mutation.lockstep import Answer, Changed
from automcm_maintenance.verify.spec_mapping import LATER, ME, NOW, Reference
from automcm_spec.graph.oracle import Oracle
from automcm_spec.vocabulary.application import Discarded, Refused, Request
from automcm_spec.vocabulary.messages import encode
from automcm_spec.vocabulary.parameters import Parameters
from automcm_spec.vocabulary.station import Input, Receive

SEED = 11


@dataclass(frozen=True)
class Variant:
    """Parameters, the time at which sessions were joined, and external durations."""

    parameters: dict[str, int] = field(default_factory=dict)
    joined_ms: int = 400
    durations: dict[str, int] = field(default_factory=dict)
    number: int = 0


VARIANTS = (
    Variant(),
    Variant(
        {"t_timeout": 2050, "t_resend": 300, "t_decide": 70, "t_cam_loss": 1001}
        | {"t_cam": 999, "backoff_min": 3, "backoff_max": 900},
        joined_ms=-3_456,
        number=4,
    ),
    Variant({"t_timeout": 0, "t_resend": 1}, 1_000, {"cam": 77, "resend": 13, "backoff": 5}),
)
"""For a large graph, only the first is used."""
Act = Callable[[], list[Effects]]
REQUEST = Request(scenario="lane_change", details={})


class AnyState:
    """The reference in any state of a graph, with all its observable behaviour."""

    def __init__(self, oracle: Oracle, variant: Variant) -> None:
        self.oracle, self.states = oracle, oracle.states
        self.variant = variant
        self.reference = Reference(oracle.constants)
        given = self.reference.station.parameters
        names = ("max_rounds", "max_participants", "outbox_limit", "memory_limit")
        limits = {name: getattr(given, name) for name in names}
        parameters = Parameters(**(limits | variant.parameters))
        self.station = self.reference.station = Station(
            ME,
            parameters,
            plan=lambda _: self.reference._plan,
            number=variant.number,
            seed=SEED,
        )
        self.station.durations = variant.durations
        message = next(value for value in oracle.inputs if isinstance(value, Receive))
        self._extra = self._extra_inputs(message)

    def _extra_inputs(self, message: Receive) -> dict[str, Act]:
        """Inputs that no graph has: all timers due at once, alone and before an input; invalid
        bytes; a time that decreases."""
        station, reference = self.station, self.reference

        def back(act: Callable[[int], object]) -> list[Effects]:
            station.advance(LATER - 1)
            act(LATER - 2)
            return []

        def late() -> list[Effects]:
            return station.receive(reference.message(message.message), LATER)

        return {
            "all timers at once": lambda: station.advance(LATER),
            "all timers, later": lambda: station.advance(LATER + 10_000),
            "all timers and a message": late,
            "all timers and a command": lambda: station.command(REQUEST, LATER),
            "a restart when all is due": lambda: station.restart(LATER),
            "no message": lambda: station.receive(b"no message", NOW),
            "no message when all is due": lambda: station.receive(b"no message", LATER),
            "time goes back": lambda: back(station.advance),
            "time goes back at a restart": lambda: back(station.restart),
        }

    def fields(self, n: int, changed: Changed) -> Changed:
        """As ``Walked.fields``."""
        return self._state(n, changed)._asdict()

    def _state(self, n: int, changed: Changed) -> State:
        self.reference.put(self.states[n])
        return self.station.state._replace(**changed)

    def answers(self, n: int, changed: Changed) -> Iterator[Answer]:
        """As ``Walked.answers``; the first is the state itself."""
        try:
            base = self._state(n, changed)
            looks = (base.marks, base.bound, base.awaits_answer, base.peer)
            timers = dict.fromkeys(armed(ME, base), LATER)
        except Exception as error:  # a mutant may raise anything
            yield Answer("the state", type(error).__name__, None, n)
            return
        yield Answer("the state", f"{timers!r}{looks!r}", None, n)
        for what, act in self._extra.items():
            yield Answer(what, *self._tried(base, timers, act), n)
        for i, value in enumerate(self.oracle.inputs):
            answer = self.oracle.answer(n, i)
            if answer is not None:
                give: Act = partial(self._give, value)
                yield Answer(value, *self._tried(base, timers, give), answer.next)

    def _give(self, value: Input) -> list[Effects]:
        return self.reference.give(value)[1]

    def _tried(self, base: State, timers: dict[Timer, int], act: Act) -> tuple[str, Changed | None]:
        """The outcome of an input in this state, and the fields of another state after it."""
        station = self.station
        station.state = base
        station.timers = timers.copy()
        station._now = 0
        try:
            station._joined_at = dict.fromkeys(base.joined, self.variant.joined_ms)
            station._random.seed(SEED)  # so that a back-off does not depend on earlier inputs
            outcome = "".join(map(_effects_text, act()))
        except Exception as error:  # a mutant may raise anything
            outcome = type(error).__name__
        then = station.state
        if then is base and station.timers == timers:
            return f"{outcome}{station._now}", None
        kept = f"{station.timers!r}{station._joined_at!r}{station.next_deadline()}{station._now}"
        return f"{outcome}{kept}{then.marks!r}", None if then is base else then._asdict()


def _effects_text(effects: Effects) -> str:
    """The effects without the rule and the detail, which are not checked (adapter.md)."""
    messages = b"".join(map(encode, effects.messages)) if effects.messages else b""
    indications = [i.name if isinstance(i, Refused | Discarded) else i for i in effects.indications]
    armed = f"{effects.armed!r}{effects.stopped!r}" if effects.armed or effects.stopped else ""
    return f"{effects.now_ms}{messages!r}{indications!r}{armed}"
