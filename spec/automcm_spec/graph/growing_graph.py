"""A graph of one station that grows while it is asked: the compiled station answers what no stored
graph contains, such as the 300th session or the 32nd participant."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from automcm_spec.graph.oracle import Effect, Oracle, OracleAnswer
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.parameters import DEFAULTS, LIMITS
from automcm_spec.vocabulary.station import Expire, Input, Session, State, Station

T = TypeVar("T")
ME = 1
"""The station's own id (oracle.py)."""
KEPT = 1_000
"""The number of answers that are kept."""


class _Numbers(dict[T, int]):
    """The number of each value; a new value gets the next one."""

    def __init__(self, added: Callable[[T], None]) -> None:
        super().__init__()
        self._added = added

    def __missing__(self, value: T) -> int:
        self[value] = len(self)
        self._added(value)
        return self[value]


class GrowingGraph(Oracle):
    """As ``Oracle``, for any peers, sessions and limits. Only ``answer``, ``given``, ``ask`` and
    ``way`` may be called."""

    def __init__(self, spec_hash: str) -> None:
        self.name, self.spec_hash = "growing", spec_hash
        self.limited(DEFAULTS)

    def limited(self, parameters: Mapping[str, int]) -> None:
        """Forget everything, and answer with these limits from now on."""
        self.constants = {constant: parameters[name] for name, constant in LIMITS.items()}
        self._station = Station(*self.constants.values())
        self.states: list[State] = []
        self.inputs: list[Input] = []
        self.marks: list[frozenset[Session]] = []
        self.input_index = _Numbers[Input](self.inputs.append)
        self.state_index = _Numbers[State](self._add)
        self._found: dict[tuple[int, int], OracleAnswer | None] = {}
        assert self.state_index[self._station.initial] == 0

    def answer(self, state: int, i: int) -> OracleAnswer | None:
        """The outcome; None for a timer that is not armed."""
        if len(self._found) >= KEPT:
            self._found.clear()
        if (state, i) not in self._found:
            self._found[state, i] = self._ask(state, i)
        return self._found[state, i]

    def _add(self, state: State) -> None:
        self.states.append(state)
        self.marks.append(self._station.marks(state))

    def _ask(self, state: int, i: int) -> OracleAnswer | None:
        before, value = self.states[state], self.inputs[i]
        if isinstance(value, Expire) and value.timer not in self._station.armed(ME, before):
            return None
        after, out, told, rule, arm, stop = self._station.step(ME, before, value)
        messages, armed, stopped = (tuple(sorted(of, key=canonical)) for of in (out, arm, stop))
        effect = Effect(messages, told, rule, armed, stopped)  # type: ignore[arg-type]
        changes = after != before or bool(arm or stop)
        return OracleAnswer(state, i, self.state_index[after], effect, changes)
