"""One step of a station that is followed: an input, what must come of it, and where it does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from automcm_spec.rules import RULES, handler, line
from automcm_spec.station import State, Timer
from automcm_traces.finding import At, Finding, Kind, Why
from automcm_traces.log import Event
from automcm_traces.track import Expected

Json = Any


class Diverges(Exception):
    """The log leaves the specification here: the finding, without its file.

    ``step`` is the step that did not go on as it must, None if nothing called for anything, and
    ``seen`` what the log has instead: ``("send", message)``, ``("arm" | "stop" | "expire",
    timer)``, ``("indication", name)``, ``("phase", name)``; empty if something is missing.
    ``off`` says of a message of which another form was called for in how many fields it is not
    that; 0 if none was.
    """

    kind: Kind = "missing"

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
        found = Finding(self.kind, rule, "", At("", at), tuple(wanted), event, Why(guard))
        if seen and self.kind == "missing":
            found = replace(found, kind="state" if seen[0] in ("phase", "role") else "unexpected")
        self.finding = found
        self.step, self.seen, self.off = step, seen, off


class Late(Diverges):
    """Something happens long after a timer should have expired."""

    kind = "overdue"


class Supposition(NamedTuple):
    """A restart, or an expiry by which the application falls back, that is not in the log."""

    what: str
    """``restart``, or the timer."""
    after: int
    """The line after which it happened."""
    before: int
    """The line before which it happened."""

    def __str__(self) -> str:
        what = "it restarted" if self.what == "restart" else f"its {self.what} expired"
        return f"{what} unseen between lines {self.after} and {self.before}"

    def as_dict(self) -> dict[str, Json]:
        """As in ``--json``."""
        return {"what": self.what, "after_line": self.after, "before_line": self.before}


class Deadline(NamedTuple):
    """When an armed timer expires, in ms of the station's clock: not before ``first``, and at
    ``last`` at the latest; None if that is not known."""

    first: int
    last: int | None
    rule: str = ""
    """What lets it expire."""


@dataclass(slots=True)
class Step:
    """One input and what is still expected to follow it."""

    at: int
    t_ms: int
    event: Event | None
    """The input as the log has it; None if it was not observed."""
    input: Json
    """As the specification has it."""
    what: str
    rule: str
    """The rule that decides."""
    after: State
    """The state that comes next."""
    changes: bool
    """Whether the state or a timer changes."""
    says: tuple[str, ...]
    """What the application hears, with its reason."""
    messages: list[Expected]
    arm: list[Timer]
    stop: list[Timer]
    told: list[str]
    given: dict[str, Json] | None
    content: Mapping[str, Json]
    since_ms: int
    """It happened at ``t_ms``, or, if the input was not observed, from this to ``t_ms``."""
    unseen: bool = False
    """Neither the input nor an effect was observed so far."""
    fresh: int = 0
    sent: list[tuple[Expected, dict[str, Json]]] = field(default_factory=list)

    @property
    def guard(self) -> str:
        """The rule, what it says, and where it stands."""
        rule = self.rule
        where = line(rule, self.input)
        return f"{rule}: {RULES.get(rule, '')} ({handler(self.input)}, Station.tla:{where})"

    def copy(self) -> Step:
        """The same step of a copy of the station."""
        return replace(
            self,
            messages=list(self.messages),
            arm=list(self.arm),
            stop=list(self.stop),
            told=list(self.told),
            sent=list(self.sent),
        )
