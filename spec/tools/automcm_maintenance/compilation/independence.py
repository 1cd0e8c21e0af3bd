"""The lemmas of Independence.tla, compiled, for sampled inputs of one station in many sessions.

TLC checks N-1 to N-3 for every input in every state, with one or two peers. Here the same operators
are compiled with the station, and evaluated for as many peers and sessions, and as large limits, as
wanted (docs/verification.md, section 7).
"""

from __future__ import annotations

import random
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias

from automcm_maintenance.compilation import compiler, sany
from automcm_spec.model_checking.models import PROPERTIES
from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary.tla_names import snake

Station: TypeAlias = Any
"""An instance of the compiled class Independence."""

LEMMAS = {name: PROPERTIES[name].removesuffix("Prop") for name in ("N-1", "N-2", "N-3")}
"""The operator that states a lemma, of a state, an outcome and an input."""

PLAN = replace(
    compiler.PLAN,
    module="Independence",
    roots={
        **compiler.PLAN.roots,
        **dict.fromkeys(LEMMAS.values(), ("Initial", "Step", "*Alphabet")),
    },
)

SHARES = {"receive": 68, "command": 20, "expire": 8, "cam": 4}
"""How often an input of a kind is drawn, in percent; a restart once in ``RESTART`` inputs."""
RESTART = 500
TRIES = 20
"""Every second time, so many inputs of a kind are tried for one that changes the state. Few targets
and proposals of all fit."""
JUMP = 10
"""Once in so many inputs, the walk goes on from an earlier state. All combinations of phase, role,
flags, number of sessions and types in the outbox are equally likely, so that the walk gets to rare
states."""
KEPT = 100
"""The number of earlier states kept of each combination."""
CURRENT = 0.7
"""The share of messages and commands for a session that the station has to do with. Of these, all
types and names are equally likely."""


def load(
    tla: Path = TLA, xml: bytes | None = None, substitutions: Mapping[str, str] | None = None
) -> ModuleType:
    """The compiled module, with the class Independence.

    ``xml`` is SANY's XML of it, if available. ``substitutions`` are those of a cfg. Raises
    tlc.TlcError if SANY cannot parse a module, sany.NotCompiled for an unsupported construct.
    """
    plan = replace(PLAN, substitutions=substitutions or {})
    code = compiler.source(plan, xml or sany.export(plan.module, tla), tla)
    module = ModuleType("automcm_spec_independence")
    exec(compile(code, "Independence.tla", "exec"), module.__dict__)
    return module


@dataclass(frozen=True)
class OpenLimits:
    """The constants of OpenStation.tla."""

    max_rounds: int
    max_participants: int
    outbox_limit: int
    memory_limit: int
    peers: frozenset[int]
    own_sessions: frozenset[int]
    peer_sessions: frozenset[int]

    def station(self, module: ModuleType) -> Station:
        """The station of a loaded module with these constants."""
        return module.Independence(**vars(self))


@dataclass(frozen=True)
class Violation:
    """A lemma that does not hold for an input in a state."""

    lemma: str
    state: Any
    input: Any
    outcome: Any


@dataclass
class WalkSample:
    """The result of a random walk."""

    inputs: int = 0
    sessions: int = 0
    """The most sessions that it was bound to, or was sending for, at once."""
    phases: set[str] = field(default_factory=set)
    violation: Violation | None = None


def sample(
    station: Station, number: int, seed: int, lemmas: Collection[str] = tuple(LEMMAS)
) -> WalkSample:
    """A random walk of ``number`` offered inputs, up to the first violation of a lemma.

    Equal arguments give equal walks.
    """
    result = WalkSample()
    checks = [(name, getattr(station, snake(LEMMAS[name]))) for name in lemmas]
    for st, i, r in _walk(station, number, seed):
        result.inputs += 1
        result.sessions = max(result.sessions, len(_active(station, st)))
        result.phases.add(st.phase)
        for name, holds in checks:
            if not holds(st, r, i):
                result.violation = Violation(name, st, i, r)
                return result
    return result


def _active(station: Station, st: Any) -> set[Any]:
    """The sessions that the station is bound to, or sends for."""
    bound = {st.session} if station.bound(st) else set()
    return bound | {e.session for e in st.outbox}


def _walk(station: Station, number: int, seed: int) -> Iterator[tuple[Any, Any, Any]]:
    """States, offered inputs and outcomes."""
    rng = random.Random(seed)
    every: dict[str, list[Any]] = {}
    of_session: dict[tuple[str, Any], dict[str, list[Any]]] = {}
    for i in sorted(station.alphabet, key=repr):
        every.setdefault(i.kind, []).append(i)
        if i.kind in ("receive", "command"):
            about, name = (i.message, i.message.type) if i.kind == "receive" else (i, i.name)
            of_session.setdefault((i.kind, about.session), {}).setdefault(name, []).append(i)
    kinds, shares = list(SHARES), list(SHARES.values())
    earlier: dict[Any, list[Any]] = {}
    st = station.initial
    while number:
        (kind,) = rng.choices(kinds, shares)
        choice = every[kind]
        if rng.randrange(RESTART) == 0:
            choice = every["restart"]
        elif kind == "expire":
            timers = sorted(station.armed(station.me, st), key=repr)
            choice = [type(choice[0])("expire", timer) for timer in timers]
        elif rng.random() < CURRENT:
            x = rng.choice([st.session, *sorted(_active(station, st))])
            if named := of_session.get((kind, x)):
                choice = named[rng.choice(list(named))]
        if not choice or not station.offered(st, i := rng.choice(choice)):
            continue
        r = station.step(station.me, st, i)
        for _ in range(rng.choice((0, TRIES))):
            if r.st != st:
                break
            if station.offered(st, other := rng.choice(choice)):
                i, r = other, station.step(station.me, st, other)
        number -= 1
        yield st, i, r
        if r.st != st:
            st = r.st
            flags = st.quarantine, st.backoff
            sent = frozenset(e.type for e in st.outbox)
            which = st.phase, st.role, flags, bool(st.joined), len(_active(station, st)), sent
            alike = earlier.setdefault(which, [])
            alike.append(st)
            if len(alike) > KEPT:
                alike.pop(rng.randrange(KEPT))
        if earlier and rng.randrange(JUMP) == 0:
            st = rng.choice(earlier[rng.choice(list(earlier))])
