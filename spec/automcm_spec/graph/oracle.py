"""The oracle: the complete graph of one station, including refusals, with queries.

It answers: in this state, given this input, what must happen, by which rule, at which line of
Station.tla? Its values are those of the compiled station (automcm_spec.vocabulary.station), in the
file in the form of automcm_spec.vocabulary.json_forms. The station's own id is 1; the ids of peers
start at 2; 9 is a stranger.
"""

from __future__ import annotations

import json
import lzma
from collections.abc import Iterable, Iterator, Set
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from automcm_spec.support import files
from automcm_spec.vocabulary import json_forms
from automcm_spec.vocabulary.json_forms import Json, canonical
from automcm_spec.vocabulary.station import Input, Message, State, Timer

FORMAT = "automcm.oracle/1"
EFFECTIVE = -1
NOT_OFFERED = -2


class OracleError(Exception):
    """An oracle that cannot be read, or is of another version; the text names the file."""


class Effect(NamedTuple):
    """The effects of a step; ``indication`` is ``("nothing",)`` if there is none.

    Messages and timers are in the order of their JSON text.
    """

    messages: tuple[Message, ...]
    indication: tuple[str, ...]
    rule: str
    arm: tuple[Timer, ...]
    stop: tuple[Timer, ...]


class OracleAnswer(NamedTuple):
    """The outcome of an input in a state. For a refusal, ``next`` equals ``state``."""

    state: int
    input: int
    next: int
    effect: Effect
    changes: bool
    """Whether it is a transition (the state or a timer changes), not a refusal."""


class Oracle:
    """A graph in memory. ``data`` is the JSON object that ``dump`` writes."""

    def __init__(self, data: dict[str, Json]) -> None:
        self.name: str = data["name"]
        self.spec_hash: str = data["spec_hash"]
        self.constants: dict[str, Json] = data["constants"]
        self.inputs = [json_forms.input_of(value) for value in data["inputs"]]
        self.states = [json_forms.state(value) for value in data["states"]]
        self.marks = [json_forms.sessions(value) for value in data["marks"]]
        self.effects = [_effect(*effect) for effect in data["effects"]]
        self._moves: list[dict[int, tuple[int, int]]] = [
            {row[k]: (row[k + 1], row[k + 2]) for k in range(0, len(row), 3)}
            for row in data["transitions"]
        ]
        self._groups: list[list[int]] = data["groups"]
        self._patterns: list[list[int]] = data["patterns"]
        self._answers: list[list[int]] = data["answers"]
        self._place = {
            j: (g, k) for g, group in enumerate(self._groups) for k, j in enumerate(group)
        }
        self.parents: list[tuple[int, int]] = [(state, i) for state, i in data["parents"]]

    @cached_property
    def state_index(self) -> dict[State, int]:
        """The number of each state."""
        return {state: n for n, state in enumerate(self.states)}

    @cached_property
    def input_index(self) -> dict[Input, int]:
        """The number of each input."""
        return {value: n for n, value in enumerate(self.inputs)}

    @property
    def transitions(self) -> int:
        """The number of pairs of state and input that change something."""
        return sum(len(moves) for moves in self._moves)

    @cached_property
    def refusals(self) -> int:
        """The number of pairs of state and offered input that change nothing."""
        of_pattern = [sum(effect >= 0 for effect in effects) for effects in self._patterns]
        return sum(of_pattern[pattern] for patterns in self._answers for pattern in patterns)

    def answer(self, state: int, i: int) -> OracleAnswer | None:
        """The outcome; None if the environment does not offer this input in this state."""
        move = self._moves[state].get(i)
        if move is not None:
            return OracleAnswer(state, i, move[0], self.effects[move[1]], True)
        group, place = self._place[i]
        effect = self._patterns[self._answers[state][group]][place]
        if effect < 0:
            return None
        return OracleAnswer(state, i, state, self.effects[effect], False)

    def ask(self, state: State, i: Input) -> OracleAnswer:
        """As ``given``, for values. Raises KeyError if the state or the input is not in the
        graph."""
        return self.given(self.state_index[state], self.input_index[i])

    def given(self, state: int, i: int) -> OracleAnswer:
        """The outcome of an input that is offered in this state. Raises KeyError if it is not
        offered."""
        answer = self.answer(state, i)
        if answer is None:
            raise KeyError(
                f"the oracle does not offer this input here: {canonical(self.inputs[i])}"
            )
        return answer

    def way(self, inputs: Iterable[int]) -> list[int]:
        """The states that these inputs lead through, from the initial state on."""
        states = [0]
        for i in inputs:
            states.append(self.given(states[-1], i).next)
        return states

    def answers(self, state: int) -> Iterator[OracleAnswer]:
        """The outcomes of all offered inputs, in the order of the alphabet."""
        return filter(None, (self.answer(state, i) for i in range(len(self.inputs))))

    def decided_by(self, rules: Set[str]) -> Iterator[OracleAnswer]:
        """The outcomes of all states and offered inputs that one of these rules decides: state by
        state, in the order of the alphabet."""
        wanted = [effect.rule in rules for effect in self.effects]
        refused = [
            [
                [(i, e) for i, e in zip(group, effects, strict=False) if e >= 0 and wanted[e]]
                for effects in self._patterns
            ]
            for group in self._groups
        ]
        for state, moves in enumerate(self._moves):
            found = [(i, to, e, True) for i, (to, e) in moves.items() if wanted[e]]
            for of_pattern, pattern in zip(refused, self._answers[state], strict=True):
                found += [(i, state, e, False) for i, e in of_pattern[pattern]]
            for i, to, e, changes in sorted(found):
                yield OracleAnswer(state, i, to, self.effects[e], changes)

    def changes(self, state: int) -> Iterator[OracleAnswer]:
        """The outcomes that change something."""
        return (self.given(state, i) for i in self._moves[state])

    def moves(self, state: int) -> dict[int, int]:
        """The inputs that change something, each with the next state."""
        return {i: move[0] for i, move in self._moves[state].items()}

    def next(self, state: int, i: int) -> int:
        """The next state of a transition."""
        return self._moves[state][i][0]

    def is_move(self, state: int, i: int) -> bool:
        """Whether this input changes something."""
        return i in self._moves[state]

    def path(self, state: int) -> list[int]:
        """A shortest sequence of inputs from the initial state to this one."""
        inputs: list[int] = []
        while state != 0:
            state, i = self.parents[state]
            inputs.append(i)
        return inputs[::-1]


def _effect(messages: Json, indication: list[str], rule: str, arm: Json, stop: Json) -> Effect:
    timers = (tuple(map(json_forms.timer, of)) for of in (arm, stop))
    return Effect(tuple(map(json_forms.message, messages)), tuple(indication), rule, *timers)


def dump(data: dict[str, Json]) -> bytes:
    """The bytes to compare for drift: canonical JSON, one line per section."""
    lines = (f"{json.dumps(name)}:{canonical(data[name])}" for name in data)
    return ("{" + ",\n".join(lines) + "}\n").encode()


def write(path: Path, content: bytes) -> None:
    """Write the bytes of ``dump`` compressed."""
    files.write(path, lzma.compress(content, preset=6))


def content(path: Path) -> bytes:
    """The uncompressed bytes. Raises OracleError if the file is missing or corrupt."""
    try:
        return lzma.decompress(path.read_bytes())
    except OSError as error:
        raise OracleError(f"{path}: {error.strerror}") from None
    except lzma.LZMAError as error:
        raise OracleError(f"{path}: corrupt: {error}") from None


def parse(data: bytes, path: Path | str, spec_hash: str | None = None) -> Oracle:
    """An oracle from its bytes. Raises OracleError if they are not JSON, or for another format or
    specification version."""
    try:
        value = json.loads(data)
    except ValueError as error:
        raise OracleError(f"{path}: not JSON: {error}") from None
    if not isinstance(value, dict) or value.get("format") != FORMAT:
        raise OracleError(f"{path}: format: must be {FORMAT}; run make generate")
    if spec_hash is not None and value.get("spec_hash") != spec_hash:
        raise OracleError(
            f"{path}: spec_hash: made from another version of the specification "
            f"({str(value.get('spec_hash'))[:12]}, here {spec_hash[:12]}); run make generate"
        )
    try:
        return Oracle(value)
    except (KeyError, ValueError) as error:
        raise OracleError(
            f"{path}: its values do not match automcm_spec/vocabulary/station.py ({error}); "
            "run make generate"
        ) from None


def load(path: Path, spec_hash: str | None = None) -> Oracle:
    """The oracle in a file; with ``spec_hash``, only if it was made from that specification."""
    return parse(content(path), path, spec_hash)
