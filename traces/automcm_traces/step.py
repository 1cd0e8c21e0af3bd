"""One step of a station that is followed: an input, what must come of it, and where it does not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from automcm_spec.oracle import Answer
from automcm_spec.rules import RULES, handler, line
from automcm_traces.track import Expected, Track, View

Json = Any


class Diverges(Exception):
    """The log leaves the specification here.

    ``step`` is the step that did not go on as it must, None if nothing called for anything, and
    ``seen`` what the log has instead: ``("send", message)``, ``("arm" | "stop" | "expire",
    timer)``, ``("indication", name)``, ``("phase", name)``; empty if something is missing.
    ``off`` says of a message of which another form was called for in how many fields it is not
    that; 0 if none was.
    """

    def __init__(
        self,
        at: int,
        event: str,
        rule: str,
        wanted: Sequence[str],
        guard: str,
        step: Step | None = None,
        seen: tuple[str, Json] | tuple[()] = (),
        off: int = 0,
    ) -> None:
        super().__init__(event)
        self.at, self.event, self.rule, self.wanted, self.guard = at, event, rule, wanted, guard
        self.step, self.seen, self.off = step, seen, off


class Deadline(NamedTuple):
    """When an armed timer expires, in ms of the station's clock: not before ``first``, and at
    ``last`` at the latest; None if that is not known."""

    first: int
    last: int | None


@dataclass(slots=True)
class Step:
    """One input and what is still expected to follow it."""

    at: int
    t_ms: int
    input: Json
    what: str
    view: View
    answer: Answer
    after: Json
    """The state of the oracle that comes next."""
    messages: list[Expected]
    arm: list[tuple[View, Json]]
    stop: list[tuple[View, Json]]
    told: list[str]
    given: dict[str, Json] | None
    content: dict[str, Json]
    since_ms: int
    """It happened at ``t_ms``, or, if the input was not observed, from this to ``t_ms``."""
    unseen: bool = False
    """Neither the input nor an effect was observed so far."""
    fresh: int = 0
    sent: list[tuple[Expected, dict[str, Json]]] = field(default_factory=list)

    @property
    def rule(self) -> str:
        """The rule that decides."""
        return self.answer.effect.rule

    @property
    def guard(self) -> str:
        """The rule, what it says, and where it stands."""
        rule = self.rule
        where = line(rule, self.input)
        return f"{rule}: {RULES.get(rule, '')} ({handler(self.input)}, Station.tla:{where})"

    def copy(self, track: Track) -> Step:
        """The same step of a copy of the station."""
        views: dict[int, View] = {}

        def on(view: View) -> View:
            return views.setdefault(id(view), view.on(track))

        return replace(
            self,
            view=on(self.view),
            messages=list(self.messages),
            arm=[(on(view), timer) for view, timer in self.arm],
            stop=[(on(view), timer) for view, timer in self.stop],
            told=list(self.told),
            sent=list(self.sent),
        )
