"""Behaviours of a closed model that take every transition of its stations at least once.

TLC prints the graph of the model: each state, and each step from it with its input.  A transition
is a station with its state and an input.  An input without effect (a repeated copy, a message
received twice) is not a step of the model but is a transition here: the walk takes it in a state
that allows it.

A walk goes from the initial state to the nearest state with a missing transition, and on from
there.  If none can be reached, the next walk begins.
"""

from __future__ import annotations

import hashlib
import re
import shutil
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

from automcm_spec.model_checking import tla_values, tlc, tlc_simulation
from automcm_spec.model_checking.models import Model
from automcm_spec.support import scratch
from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary import renumbering
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.station import Input, Message, Receive, Session, State
from automcm_traces.export import behaviour_to_log
from automcm_traces.export.behaviour_effects import EffectQuery, effects_of
from automcm_traces.export.behaviour_steps import Move, steps_of
from automcm_traces.export.behaviour_to_log import StepEffects

MODULE = """---- MODULE Graph ----
EXTENDS {module}, Simulation, TLC
VARIABLE place
GInit == Init /\\ place = 0 /\\ TLCSet(9, 0)
Node == /\\ PrintT(ToString(<<"node", place>>))
        /\\ \\E v \\in {{view}} : v = v /\\ PrintT(ToString(<<v>>))
        /\\ \\A s \\in Stations : \\A i \\in Inputs(s) : PrintT(ToString(<<"may", s, i>>))
GNext == \\E s \\in Stations : \\E i \\in Inputs(s) :
  /\\ Do(s, i)
  /\\ TLCSet(9, TLCGet(9) + 1) /\\ place' = TLCGet(9)
  /\\ PrintT(ToString(<<"step", place, s, i>>)) 
  /\\ \\E v \\in {{view'}} : v = v /\\ PrintT(ToString(<<v>>))
GSpec == GInit /\\ [][GNext]_<<vars, place>>
====
"""
"""``place`` numbers the states, and the VIEW hides it.  Node is an invariant, so TLC looks at it
once for each state.  ``v = v`` normalizes a value, so that equal ones have equal texts."""

AT_ONCE = 1500
"""Queries to TLC in one run."""
Key = tuple[int, Input]
"""A station and its input."""
Walk = list[tuple[int, Key, int]]
"""Steps: a node, the station and its input, the next node."""


class Transition(NamedTuple):
    """A transition of one station: its state and the input as texts, from the station's view.

    The station itself is 1; the others are 2, 3, … in the order in which state and input name them,
    so that equal behaviour of two stations is one transition.  Whether the application is concerned
    only counts for an Advertisement.
    """

    state: str
    input: str

    @property
    def digest(self) -> str:
        """A short name for it."""
        return hashlib.sha256("\n".join(self).encode()).hexdigest()[:12]


@cache
def transition(station: int, at: State, value: Input) -> Transition:
    """The transition of a station in a state with this input."""
    ids = {0: 0, station: 1}

    def to(of: Session) -> Session:
        return ids.setdefault(of[0], len(ids)), of[1]

    outbox = sorted(at.outbox, key=canonical)
    named = [at.session[0], at.target, *sorted(at.recorded), *sorted(at.withdrawn)]
    named += [s[0] for s in sorted(at.joined)] + [p for e in outbox for p in (e.to, e.session[0])]
    for p in named:
        renumbering.station(p, to)
    if isinstance(value, Receive):
        concerned = value.concerned and value.message.type == "Advertisement"
        value = value._replace(concerned=concerned)
    seen = renumbering.state(at, to)
    return Transition(canonical(seen), canonical(renumbering.input_of(value, to)))


@dataclass
class ModelNode:
    """A state of the model: the stations, the radio, the inputs and the next states.

    ``idle`` are the inputs without effect.
    """

    st: dict[int, State]
    net: frozenset[Message]
    steps: dict[Key, int] = field(default_factory=dict)
    idle: list[Key] = field(default_factory=list)

    def transition(self, key: Key) -> Transition:
        """That of a station with an input."""
        return transition(key[0], self.st[key[0]], key[1])


class ModelGraph:
    """The graph of a closed model, as printed by TLC.  Node 0 is the initial state."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.cfg = model.config
        self.nodes: dict[int, ModelNode] = {}
        self._by_view: dict[str, int] = {}
        self._steps: list[tuple[int, Key, str]] = []
        self._open: tuple[Any, ...] = ()
        self._node = ModelNode({}, frozenset())
        self._run()
        for source, key, view in self._steps:
            self.nodes[source].steps[key] = self._by_view[view]
        for node in self.nodes.values():
            node.idle = [key for key in node.idle if key not in node.steps]

    def _run(self) -> None:
        text = re.sub(r"^SPECIFICATION \w+$", "SPECIFICATION GSpec", self.cfg, flags=re.M)
        rest = r"^(PROPERTIES|PROPERTY|INVARIANTS?|ACTION_CONSTRAINT) .*\n"
        text = re.sub(rest, "", text, flags=re.M)
        with scratch.folder("graph") as place:
            for path in TLA.glob("*.tla"):
                shutil.copy(path, place)
            (place / "Graph.tla").write_text(MODULE.format(module=self.model.module))
            (place / "Graph.cfg").write_text(text + "INVARIANT Node\n")
            tlc.run("Graph", place / "Graph.cfg", tla_dir=place, on_print=self._line)

    def _line(self, line: str) -> None:
        if line.startswith('"<<\\"node'):
            self._open = ("node", int(line.split(",")[1].split(">")[0]))
        elif line.startswith('"<<\\"step'):
            _, source, rest = line.split(", ", 2)
            self._open = ("step", int(source), _input(rest))
        elif line.startswith('"<<\\"may'):
            self._node.idle.append(_input(line.split(", ", 1)[1]))
        elif line.startswith('"<<') and self._open:
            if self._open[0] == "node":
                self._by_view[line] = self._open[1]
                self._node = self.nodes[self._open[1]] = _node(line)
            else:
                self._steps.append((self._open[1], self._open[2], line))
            self._open = ()

    @property
    def max_rounds(self) -> int:
        """MaxRounds of the model."""
        found = re.search(r"^  MaxRounds = (\d+)$", self.cfg, re.M)
        assert found is not None, "every model says it"
        return int(found[1])

    @property
    def transitions(self) -> set[Transition]:
        """All transitions of the stations in reachable states."""
        return {
            node.transition(key)
            for node in self.nodes.values()
            for key in (*node.steps, *node.idle)
        }

    def walks(self, seen: Iterable[Transition] = ()) -> list[Walk]:
        """Walks that take every transition except those seen in other models."""
        missing = self.transitions - set(seen)
        walks = []
        while missing:
            at, walk = 0, []
            while (path := self._nearest(at, missing)) is not None:
                for source, key, target in path:
                    walk += self._take_idle(source, missing)
                    walk.append((source, key, target))
                    missing.discard(self.nodes[source].transition(key))
                    at = target
                walk += self._take_idle(at, missing)
            walks.append(walk)
        return walks

    def _take_idle(self, at: int, missing: set[Transition]) -> Walk:
        node, taken = self.nodes[at], []
        for key in node.idle:
            if (transition := node.transition(key)) in missing:
                missing.discard(transition)
                taken.append((at, key, at))
        return taken

    def _nearest(self, at: int, missing: set[Transition]) -> Walk | None:
        """The shortest walk from a node to a missing transition; None if there is none."""
        seen = {at}
        queue: deque[tuple[int, Walk]] = deque([(at, [])])
        while queue:
            n, walk = queue.popleft()
            node = self.nodes[n]
            for key, target in node.steps.items():
                if node.transition(key) in missing:
                    return [*walk, (n, key, target)]
            if any(node.transition(key) in missing for key in node.idle):
                return walk
            for key, target in node.steps.items():
                if target not in seen:
                    seen.add(target)
                    queue.append((target, [*walk, (n, key, target)]))
        return None

    def logs(self, walks: list[tuple[str, Walk]]) -> list[dict[int, bytes]]:
        """The logs of named walks, by station, from one query to TLC.

        Raises tlc.TlcError, BehaviourError.
        """

        def effects(queries: Iterable[EffectQuery]) -> dict[EffectQuery, StepEffects]:
            wanted, found = list(dict.fromkeys(queries)), dict[EffectQuery, StepEffects]()
            for n in range(0, len(wanted), AT_ONCE):
                found |= effects_of(self.model.module, self.cfg, wanted[n : n + AT_ONCE])
            return found

        moves = [[self._move(*step) for step in walk] for _, walk in walks]
        histories = steps_of(moves, effects, "Reduced = TRUE" in self.cfg)
        return [
            behaviour_to_log.logs(
                run, some, sorted(self.nodes[0].st), {"max_rounds": self.max_rounds}
            )
            for (run, _), some in zip(walks, histories, strict=True)
        ]

    def _move(self, source: int, key: Key, target: int) -> Move:
        one, two = self.nodes[source], self.nodes[target]
        return Move(*key, one.st, two.st, one.net, two.net)


@cache
def _input(text: str) -> Key:
    """The station and the input at the end of a printed tuple."""
    unquoted = tla_values.parse(f'"{text}')
    parsed: Any = tla_values.parse(f"<<{unquoted}")
    return parsed[0], tlc_simulation.input_of(parsed[1])


def _node(line: str) -> ModelNode:
    text = tla_values.parse(line)
    assert isinstance(text, str)
    parsed: Any = tla_values.parse(text)
    stations, net, *_ = parsed[0]
    st = {s: tlc_simulation.state(value) for s, value in enumerate(stations, 1)}
    messages = frozenset(behaviour_to_log.plain(Message(**m)) for m in net)
    return ModelNode(st, messages)
