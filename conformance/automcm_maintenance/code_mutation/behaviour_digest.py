"""All that the reference says and keeps, at each state of a graph, as a digest: two sources with
the same digests behave the same there.

It is imported after the reference has been replaced (mutated_process.py), and by nobody else.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence, Set
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Protocol

from automcm.adapters.spec_mapping import LATER, ME, NOW, Reference
from automcm.core.state import State, Timer, armed
from automcm.core.station import Effects, Station
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
    """Parameters, when what is remembered was joined, and durations set from outside."""

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
"""The first stands for all where the graph is large."""


ODD = "odd"
"""The kind of what is always looked at: the state itself, and inputs that no graph has."""
Act = Callable[[], list[Effects]]
REQUEST = Request(scenario="lane_change", details={})


class Walker:
    """The reference in any state of a graph, and everything that may be told of it."""

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
        """The state itself, then each input there, odd ones as well: its kind, the input, and all
        that it brings about.  With ``kinds`` only inputs of these."""
        station, reference = self.station, self.reference
        reference.put(self.oracle.states[n])
        base, timers = station.state, station.timers.copy()
        self._remember(base)
        station._random.seed(SEED)
        looks = (base.marks, base.bound, base.awaits_answer, base.peer)
        yield ODD, "the state", f"{self._kept()}{looks!r}"
        message: Receive | None = None
        for i, name in enumerate(self.kinds):
            value = self.oracle.inputs[i]
            if message is None and isinstance(value, Receive):
                message = value
            if (kinds is None or name in kinds) and self.oracle.answer(n, i) is not None:
                yield name, value, self._tried(base, timers, partial(self._give, value))
        assert message is not None
        for what, act in self._odd(message).items():
            yield ODD, what, self._tried(base, timers, act)

    def _give(self, value: Input) -> list[Effects]:
        return self.reference.give(value)[1]

    def _odd(self, message: Receive) -> dict[str, Act]:
        """What no graph has: everything due at once, alone and before an input; no message at
        all; a time that goes back."""
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
        """What an input brings about from here."""
        station = self.station
        station.state = base
        station.timers = timers.copy()
        station._now = 0
        said = _said(act)
        if station.state is base and station.timers == timers:
            return f"{said}{station._now}"
        kept = f"{said}{self._kept()}{station.state.marks!r}"
        self._remember(base)
        station._random.seed(SEED)  # else a back-off would depend on what was tried before
        return kept

    def at(self, n: int) -> State:
        """The state that stands for this one of the graph."""
        self.reference.put(self.oracle.states[n])
        return self.station.state

    def said(self, state: State, value: Input) -> tuple[str, State]:
        """What an input brings about in a state, but for the state, and the state after it."""
        station = self.station
        station.state = state
        station.timers = dict.fromkeys(armed(ME, state), LATER)
        station._now = 0
        self._remember(state)
        station._random.seed(SEED)
        text = _said(partial(self._give, value))
        return f"{text}{station.timers!r}{station.state.marks!r}", station.state

    def digests(self, n: int, kinds: Set[str] | None = None) -> dict[str, bytes]:
        """Of each kind of input all answers at a state, in a few bytes."""
        found = {ODD: hashlib.blake2b(digest_size=SIZE)}
        try:
            for name, _, text in self.answers(n, kinds):
                if name not in found:
                    found[name] = hashlib.blake2b(digest_size=SIZE)
                found[name].update(text.encode())
        except Exception as error:  # not even a state can be set up
            found[ODD].update(type(error).__name__.encode())
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


def _said(act: Act) -> str:
    """All that an input brings about; which exception, if it raises one."""
    try:
        return "".join(map(_told, act()))
    except Exception as error:  # a mutant may raise anything
        return type(error).__name__


def _told(effects: Effects) -> str:
    """All of it but the rule and the detail, which explain and are not judged (adapter.md)."""
    messages = b"".join(map(encode, effects.messages)) if effects.messages else b""
    told = [i.name if isinstance(i, Refused | Discarded) else i for i in effects.indications]
    armed = f"{effects.armed!r}{effects.stopped!r}" if effects.armed or effects.stopped else ""
    return f"{effects.now_ms}{messages!r}{told!r}{armed}"


class Walked(Protocol):
    """A graph with the reference in it, or the forms of messages (forms.py)."""

    @property
    def states(self) -> Sequence[object]:
        """All, by number; 0 is the initial one."""

    def digests(self, n: int, kinds: Set[str] | None = None) -> dict[str, bytes]:
        """What every input does in state ``n``: a digest of the answer, by input."""

    def shown(self, n: int) -> list[tuple[str, str]]:
        """The inputs of state ``n`` and what they do, to read."""


def write(walked: Walked, path: Path) -> None:
    """The digests of a graph, a line for each state."""
    with files.writing(path) as out:
        for n in range(len(walked.states)):
            found = walked.digests(n)
            line = json.dumps({kind: digest.hex() for kind, digest in found.items()}) + "\n"
            out.write(line.encode())


def first_difference(
    walked: Walked, known: Path, kinds: Set[str] | None
) -> tuple[int, list[str]] | None:
    """The first state that is not as known, and the kinds of input that are answered otherwise;
    with ``kinds`` only inputs of these are given."""
    with known.open() as lines:
        for n, line in enumerate(lines):
            wanted = json.loads(line)
            found = walked.digests(n, kinds)
            others = [kind for kind, d in found.items() if wanted.get(kind, "") != d.hex()]
            if others:
                return n, others
    return None
