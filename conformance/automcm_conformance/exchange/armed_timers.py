"""The kit's clock of a station's armed timers: which timer expires next, and when."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from operator import attrgetter
from typing import Generic, TypeVar

from automcm_spec.vocabulary.parameters import rank

UNKNOWN = -1
"""A deadline that only the station knows."""
T = TypeVar("T", bound=Hashable)
_TURN = attrgetter("deadline", "rank", "age")
"""The order in which timers fire (protocol.md, section 3)."""


@dataclass(slots=True)
class Running(Generic[T]):
    """An armed timer. ``age`` orders timers of one rank: that of the older message comes first, and
    messages of one input are of one age."""

    timer: T
    deadline: int
    rank: int
    age: int
    message: Hashable = None


class ArmedTimers(Generic[T]):
    """The armed timers by their names; a deadline is in ms, or UNKNOWN."""

    def __init__(self) -> None:
        self.running: dict[T, Running[T]] = {}
        self.inputs = 0
        """How many inputs have armed timers."""
        self._seen: tuple[Running[T] | None, bool] | None = None

    def arm(self, timer: T, deadline: int, message: Hashable = None, type_: str = "") -> None:
        """Arm a timer, or arm it again. ``message``: the message it belongs to, of type
        ``type``."""
        name = getattr(timer, "name", None) or timer[0]  # type: ignore[index]
        age = 0 if message is None else self._age(message)
        self.running.pop(timer, None)
        place = rank(name, type_ == "Advertisement")
        self.running[timer] = Running(timer, deadline, place, age, message)
        self._seen = None

    def _age(self, message: Hashable) -> int:
        """The age of a message that has an armed timer, or else of a new one: when nothing of a
        session is remembered any more, an equal message may follow."""
        armed = (each.age for each in self.running.values() if each.message == message)
        return next(armed, self.inputs)

    def stop(self, timer: T) -> None:
        """Remove a timer that is stopped or has expired."""
        del self.running[timer]
        self._seen = None

    def learn(self, timer: T, deadline: int) -> None:
        """Set a deadline that only the station knew."""
        self.running[timer].deadline = deadline
        self._seen = None

    def deadline(self, timer: T) -> int | None:
        """The deadline of a timer; None if it is not armed."""
        running = self.running.get(timer)
        return None if running is None else running.deadline

    @property
    def first(self) -> Running[T] | None:
        """The timer that expires next, of those whose deadline is known."""
        return self._look()[0]

    @property
    def sure(self) -> bool:
        """Whether all deadlines are known."""
        return self._look()[1]

    def due(self, now: int) -> T | None:
        """The due timer that fires next; None if no timer is due."""
        first = self.first
        return first.timer if first is not None and first.deadline <= now else None

    def _look(self) -> tuple[Running[T] | None, bool]:
        """``first`` and ``sure``, until a timer changes."""
        if self._seen is None:
            known = [each for each in self.running.values() if each.deadline != UNKNOWN]
            self._seen = min(known, key=_TURN, default=None), len(known) == len(self.running)
        return self._seen
