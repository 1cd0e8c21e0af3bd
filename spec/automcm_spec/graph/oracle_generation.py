"""Writes the oracle: runs TLC on OpenStation and puts its output in canonical order."""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from automcm_spec.graph.oracle import EFFECTIVE, FORMAT, NOT_OFFERED, OracleError, dump, load
from automcm_spec.model_checking import tlc
from automcm_spec.support import scratch
from automcm_spec.support.paths import ORACLES, TLA
from automcm_spec.vocabulary.json_forms import Json, canonical
from automcm_spec.vocabulary.parameters import LIMITS

MODULES = ("Station", "OpenStation")
"""The modules that an oracle depends on."""


@dataclass(frozen=True, slots=True)
class Graph:
    """The constants of one graph."""

    name: str
    peers: Sequence[int]
    own_sessions: int
    peer_sessions: int
    max_rounds: int
    outbox_limit: int
    max_participants: int
    memory_limit: int = 4

    @property
    def path(self) -> Path:
        """The file of the graph."""
        return ORACLES / f"{self.name}.json.xz"

    @property
    def constants(self) -> dict[str, Json]:
        """The constants of OpenStation."""
        return {
            **{constant: getattr(self, name) for name, constant in LIMITS.items()},
            "Peers": list(self.peers),
            "OwnSessions": list(range(1, self.own_sessions + 1)),
            "PeerSessions": list(range(1, self.peer_sessions + 1)),
        }


ONE_PEER = Graph("one-peer", (2,), 2, 2, 3, 5, 1)
TWO_PEERS = Graph("two-peers", (2, 3), 2, 2, 3, 5, 2)
TIGHT = Graph("tight", (2, 3), 1, 1, 1, 3, 1, memory_limit=1)
"""Two peers, and memory for one, so that MEM-1 applies."""
GRAPHS = {graph.name: graph for graph in (ONE_PEER, TWO_PEERS, TIGHT)}
"""The graphs stored on disk."""
SMALL = Graph("small", (2,), 2, 2, 2, 3, 1)
"""For the short loop of ``automcm verify --rule``, never on disk. TLC needs a second or two, and
the comparison detects the removal of any rule, as with ONE_PEER."""


def spec_hash(tla: Path = TLA) -> str:
    """The hash of the specification that an oracle is made from."""
    digest = hashlib.sha256()
    for module in MODULES:
        digest.update((tla / f"{module}.tla").read_bytes())
    return digest.hexdigest()


def recorded_hash() -> str | None:
    """The hash of the specification that the committed one-peer graph was made from.

    None if that graph is missing or unreadable.
    """
    try:
        return load(ONE_PEER.path).spec_hash
    except OracleError:
        return None


def _config(graph: Graph) -> str:
    def value(v: Json) -> str:
        return "{" + ", ".join(map(str, v)) + "}" if isinstance(v, list) else str(v)

    constants = "\n".join(f"  {name} = {value(v)}" for name, v in graph.constants.items())
    return (
        f"CONSTANTS\n{constants}\nINIT Init\nNEXT Next\nINVARIANT TypeInv\nCHECK_DEADLOCK FALSE\n"
    )


def _untla(line: str) -> Json:
    """A line of PrintT(ToString(tuple)) as JSON: tuples and sets become lists."""
    text = line[1:-1].replace('\\"', '"')
    text = text.replace("<<", "[").replace(">>", "]").replace("{", "[").replace("}", "]")
    return json.loads(text.replace("TRUE", "true").replace("FALSE", "false"))


def _sorted(values: list[Json]) -> list[Json]:
    return sorted(values, key=canonical)


def _state(value: list[Json]) -> list[Json]:
    """The tuple of a state with its sets sorted."""
    for n in (3, 4, 10, 11):
        value[n] = _sorted(value[n])
    return value


class _Print:
    """Collects the output of OpenStation."""

    def __init__(self) -> None:
        self.inputs: dict[int, Json] = {}
        self.base: dict[int, int] = {}
        self.effects: list[Json] = []
        self._effect_index: dict[str, int] = {}
        self.marks: dict[str, Json] = {}
        self.moves: dict[str, list[tuple[int, str, int]]] = {}
        self.answers: dict[str, list[tuple[int, int]]] = {}
        self.missing: dict[str, list[int]] = {}

    def effect(self, out: Json, indication: Json, rule: str, arm: Json, stop: Json) -> int:
        value = [_sorted(out), indication, rule, _sorted(arm), _sorted(stop)]
        text = canonical(value)
        if text not in self._effect_index:
            self._effect_index[text] = len(self.effects)
            self.effects.append(value)
        return self._effect_index[text]

    def line(self, line: str) -> None:
        if line.startswith('"<<\\"INPUT'):
            _, j, value, base = _untla(line)
            if value[0] == "cam":
                value[2] = _sorted(value[2])
            self.inputs[j] = value
            if base:
                out, indication, rule = base
                self.base[j] = self.effect(out, indication, rule, [], [])
        elif line.startswith('"<<\\"STATE'):
            _, state, marks, changes, answers, missing = _untla(line)
            key = canonical(_state(state))
            self.marks[key] = _sorted(marks)
            self.moves[key] = [
                (j, canonical(_state(after)), self.effect(out, indication, rule, arm, stop))
                for j, after, out, indication, rule, arm, stop in changes
            ]
            self.answers[key] = [
                (j, self.effect(out, indication, rule, [], []))
                for j, (out, indication, rule) in answers
            ]
            self.missing[key] = missing


def build(
    graph: Graph,
    *,
    tla: Path = TLA,
    workers: int = 2,
    short: bool = False,
    stop: tlc.TlcStop | None = None,
) -> tuple[dict[str, Json], tlc.TlcResult]:
    """The oracle's data (see ``oracle.dump``) and TLC's result; ``short`` is as for ``tlc.run``.

    Raises tlc.TlcError if TLC fails, ValueError if its output is not the complete graph.
    """
    printed = _Print()
    with scratch.folder("oracle") as folder:
        cfg = folder / f"{graph.name}.cfg"
        cfg.write_text(_config(graph))
        result = tlc.run(
            "OpenStation",
            cfg,
            workers=workers,
            short=short,
            tla_dir=tla,
            on_print=printed.line,
            stop=stop,
        )
    if result.outcome != "holds":
        raise ValueError(f"OpenStation: {result.property} is violated")
    if len(printed.moves) != result.distinct_states:
        raise ValueError(
            f"OpenStation: printed {len(printed.moves)} states; expected {result.distinct_states}"
        )
    return _data(graph, printed, spec_hash(tla)), result


def _data(graph: Graph, printed: _Print, version: str) -> dict[str, Json]:
    """Canonical order: inputs by their text, states in the order of a breadth-first search."""
    by_text = sorted(printed.inputs, key=lambda j: canonical(printed.inputs[j]))
    number = {j: n for n, j in enumerate(by_text)}
    inputs = [printed.inputs[j] for j in by_text]
    group_of = ["/".join(_group(value)) for value in inputs]
    names = sorted(set(group_of))
    groups = [[n for n, g in enumerate(group_of) if g == name] for name in names]

    initial = next((key for key in printed.moves if key.startswith(_INITIAL)), None)
    if initial is None:
        raise ValueError(
            f"OpenStation: printed no initial state; expected {_INITIAL} (oracle_generation.py)"
        )
    order, parents = {initial: 0}, [[0, 0]]
    queue = deque([initial])
    while queue:
        key = queue.popleft()
        for j, after, _ in sorted(printed.moves[key], key=lambda move: number[move[0]]):
            if after not in order:
                order[after] = len(order)
                parents.append([order[key], number[j]])
                queue.append(after)

    used: dict[int, int] = {}
    patterns: dict[tuple[int, ...], int] = {}
    transitions, answers = [], []
    for key in order:
        row: list[int] = []
        vector = [printed.base.get(j, NOT_OFFERED) for j in by_text]
        for j, effect in printed.answers[key]:
            vector[number[j]] = effect
        for j in printed.missing[key]:
            vector[number[j]] = NOT_OFFERED
        for j, value in enumerate(inputs):
            if value[0] == "expire":
                vector[j] = NOT_OFFERED
        for n, after, effect in sorted((number[j], a, e) for j, a, e in printed.moves[key]):
            vector[n] = EFFECTIVE
            row += [n, order[after], used.setdefault(effect, len(used))]
        transitions.append(row)
        state_answers = []
        for group in groups:
            pattern = tuple(
                e if e < 0 else used.setdefault(e, len(used)) for e in (vector[n] for n in group)
            )
            state_answers.append(patterns.setdefault(pattern, len(patterns)))
        answers.append(state_answers)
    return {
        "format": FORMAT,
        "name": graph.name,
        "spec_hash": version,
        "constants": graph.constants,
        "inputs": inputs,
        "groups": groups,
        "effects": [printed.effects[effect] for effect in used],
        "states": [json.loads(key) for key in order],
        "marks": [printed.marks[key] for key in order],
        "parents": parents,
        "transitions": transitions,
        "patterns": [list(pattern) for pattern in patterns],
        "answers": answers,
    }


_INITIAL = '["STANDALONE","none",[0,0],[],[],0,0,false,false,0,[],[],false,false]'


def _group(value: Json) -> list[str]:
    """The group of an input; the outcomes of a group are stored together."""
    if value[0] == "receive":
        return ["receive", value[1][0], str(value[1][1])]
    if value[0] == "command":
        return ["command", value[1]]
    return [value[0]]


def generate(graph: Graph, **options: Any) -> bytes:
    """The oracle as bytes."""
    return dump(build(graph, **options)[0])
