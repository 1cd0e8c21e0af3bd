"""Digests of the reference's outputs and states at each state of a graph.

Two sources with equal digests behave equally there.  This module is only imported after the
reference has been replaced (mutated_process.py).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Protocol

from automcm.core.state import State, Timer, armed
from automcm.core.station import Effects, Station
from automcm_maintenance.verify.spec_mapping import LATER, ME, NOW, Reference
from automcm_spec.graph.oracle import Oracle
from automcm_spec.support import files
from automcm_spec.vocabulary.application import Discarded, Refused, Request
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.messages import encode
from automcm_spec.vocabulary.parameters import Parameters
from automcm_spec.vocabulary.rules import kind
from automcm_spec.vocabulary.station import Input, Receive

SEED = 11
SIZE = 8
"""Bytes of a digest."""


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


EXTRA = "odd"
"""The kind of answers that are always compared: the state, and inputs that no graph has."""
Act = Callable[[], list[Effects]]
REQUEST = Request(scenario="lane_change", details={})


class AnyState:
    """The reference in any state of a graph, with all its observable behaviour."""

    def __init__(self, oracle: Oracle, variant: Variant) -> None:
        self.oracle, self.states = oracle, oracle.states
        self.variant = variant
        self.reference = Reference(oracle.constants)
        parameters = Parameters(**(self._limits() | variant.parameters))
        self.station = self.reference.station = Station(
            ME,
            parameters,
            plan=lambda _: self.reference._plan,
            number=variant.number,
            seed=SEED,
        )
        self.station.durations = variant.durations
        self.kinds = [kind(value) for value in oracle.inputs]

    def _limits(self) -> dict[str, int]:
        p = self.reference.station.parameters
        names = ("max_rounds", "max_participants", "outbox_limit", "memory_limit")
        return {name: getattr(p, name) for name in names}

    def _kept(self) -> str:
        s = self.station
        return f"{s.state!r}{s.timers!r}{s._joined_at!r}{s.next_deadline()}{s._now}"

    def answers(
        self, n: int, kinds: Set[str] | None = None
    ) -> Iterator[tuple[str, Input | str, str]]:
        """The state itself, then each input including extra ones: its kind, the input and its
        outcome.  With ``kinds``, only inputs of these kinds."""
        station, reference = self.station, self.reference
        reference.put(self.oracle.states[n])
        base, timers = station.state, station.timers.copy()
        self._remember(base)
        station._random.seed(SEED)
        looks = (base.marks, base.bound, base.awaits_answer, base.peer)
        yield EXTRA, "the state", f"{self._kept()}{looks!r}"
        message: Receive | None = None
        for i, name in enumerate(self.kinds):
            value = self.oracle.inputs[i]
            if message is None and isinstance(value, Receive):
                message = value
            if (kinds is None or name in kinds) and self.oracle.answer(n, i) is not None:
                yield name, value, self._tried(base, timers, partial(self._give, value))
        assert message is not None
        for what, act in self._extra_inputs(message).items():
            yield EXTRA, what, self._tried(base, timers, act)

    def _give(self, value: Input) -> list[Effects]:
        return self.reference.give(value)[1]

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

    def _remember(self, base: State) -> None:
        self.station._joined_at = dict.fromkeys(base.joined, self.variant.joined_ms)

    def _tried(self, base: State, timers: dict[Timer, int], act: Act) -> str:
        """The outcome of an input in this state."""
        station = self.station
        station.state = base
        station.timers = timers.copy()
        station._now = 0
        outcome = _outcome_text(act)
        if station.state is base and station.timers == timers:
            return f"{outcome}{station._now}"
        kept = f"{outcome}{self._kept()}{station.state.marks!r}"
        self._remember(base)
        station._random.seed(SEED)  # so that a back-off does not depend on earlier inputs
        return kept

    def at(self, n: int) -> State:
        """The reference's state for this state of the graph."""
        self.reference.put(self.oracle.states[n])
        return self.station.state

    def outcome(self, state: State, value: Input) -> tuple[str, State]:
        """The outcome of an input in a state, without the next state, and the next state."""
        return self._outcome(state, partial(self._give, value)), self.station.state

    def extra_outcomes(self, state: State) -> list[str]:
        """The outcomes of the extra inputs in a state, without the next states."""
        message = next(value for value in self.oracle.inputs if isinstance(value, Receive))
        return [self._outcome(state, act) for act in self._extra_inputs(message).values()]

    def _outcome(self, state: State, act: Act) -> str:
        station = self.station
        station.state = state
        station.timers = dict.fromkeys(armed(ME, state), LATER)
        station._now = 0
        self._remember(state)
        station._random.seed(SEED)
        return f"{_outcome_text(act)}{station.timers!r}{station.state.marks!r}"

    def digests(self, n: int, kinds: Set[str] | None = None) -> dict[str, bytes]:
        """For each kind of input, a digest of all answers at a state."""
        found = {EXTRA: hashlib.blake2b(digest_size=SIZE)}
        try:
            for name, _, text in self.answers(n, kinds):
                if name not in found:
                    found[name] = hashlib.blake2b(digest_size=SIZE)
                found[name].update(text.encode())
        except Exception as error:  # the state cannot be set up
            found[EXTRA].update(type(error).__name__.encode())
        return {kind: value.digest() for kind, value in found.items()}

    def shown(self, n: int) -> list[tuple[str, str]]:
        """All answers at a state, as text."""
        out: list[tuple[str, str]] = []
        try:
            for _, value, text in self.answers(n):
                out.append((value if isinstance(value, str) else canonical(value), text))
        except Exception as error:
            out.append(("the state", type(error).__name__))
        return out


def _outcome_text(act: Act) -> str:
    """The outcome of an input as text, or the name of the exception that it raises."""
    try:
        return "".join(map(_effects_text, act()))
    except Exception as error:  # a mutant may raise anything
        return type(error).__name__


def _effects_text(effects: Effects) -> str:
    """The effects without the rule and the detail, which are not checked (adapter.md)."""
    messages = b"".join(map(encode, effects.messages)) if effects.messages else b""
    indications = [i.name if isinstance(i, Refused | Discarded) else i for i in effects.indications]
    armed = f"{effects.armed!r}{effects.stopped!r}" if effects.armed or effects.stopped else ""
    return f"{effects.now_ms}{messages!r}{indications!r}{armed}"


class Walked(Protocol):
    """A graph with the reference, or the forms of messages (accepted_forms.py)."""

    @property
    def states(self) -> Sequence[object]:
        """All states by number; 0 is the initial one."""

    def digests(self, n: int, kinds: Set[str] | None = None) -> dict[str, bytes]:
        """The digests of the answers in state ``n``, by kind of input."""

    def shown(self, n: int) -> list[tuple[str, str]]:
        """The inputs of state ``n`` and their outcomes as text."""


def write(walked: Walked, path: Path) -> None:
    """Write the digests of a graph, one line for each state."""
    with files.writing(path) as out:
        for n in range(len(walked.states)):
            found = walked.digests(n)
            line = json.dumps({kind: digest.hex() for kind, digest in found.items()}) + "\n"
            out.write(line.encode())


def first_difference(
    walked: Walked, known: Path, kinds: Set[str] | None
) -> tuple[int, list[str]] | None:
    """The first state with other digests than the known ones, and the kinds of input that differ.

    With ``kinds``, only inputs of these kinds are given.
    """
    with known.open() as lines:
        for n, line in enumerate(lines):
            wanted = json.loads(line)
            found = walked.digests(n, kinds)
            others = [kind for kind, d in found.items() if wanted.get(kind, "") != d.hex()]
            if others:
                return n, others
    return None
