"""Findings as values: text, JSON and exit codes are made from them at the edge."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from automcm_spec.log_format.log import Timer
from automcm_spec.support.bad_input import BadInput
from automcm_spec.vocabulary.messages import Fields
from automcm_traces.checker.track import InputStep

Kind = Literal[
    "nothing",
    "missing",
    "unexpected",
    "state",
    "overdue",
    "forged",
    "property",
    "format",
    "cannot_tell",
    "unreadable",
]
"""``missing``: an expected effect is missing. ``unexpected``: an event that no input calls for, or
not in this form. ``state``: another phase or role. ``overdue``: a timer did not expire. ``forged``:
a received message differs from the sent one. ``property``: a system property (S-*, T-*) is
violated. ``format``: a check of lint failed."""


Answer = Literal["allowed", "diverges", "cannot_tell", "unreadable"]
EXIT: dict[Answer, int] = {"allowed": 0, "diverges": 1, "unreadable": 3, "cannot_tell": 4}


def answer(kind: Kind) -> Answer:
    """The verdict for a kind of finding."""
    if kind == "cannot_tell" or kind == "unreadable":
        return kind
    return "allowed" if kind == "nothing" else "diverges"


def worst(answers: Iterable[Answer]) -> int:
    """The exit code for the most severe verdict: diverges, then unreadable, then cannot tell."""
    codes = {EXIT[answer] for answer in answers}
    return next((code for code in (1, 3, 4) if code in codes), 0)


class Where(NamedTuple):
    """A place in a file; line 0 means the whole file, an empty field the whole line."""

    file: str = ""
    line: int = 0
    field: str = ""


NOWHERE = Where()


@dataclass(frozen=True, slots=True)
class Finding:
    """One problem in a log. From ``guard`` on it says why; empty if unknown."""

    kind: Kind
    rule: str = ""
    """A rule id of docs/protocol.md; for the kind ``format``, the name of the check."""
    property: str = ""
    at: Where = NOWHERE
    expected: tuple[str, ...] = ()
    observed: str = ""
    """The event observed instead, as text."""
    guard: str = ""
    """The deciding rule, its meaning, and its location in Station.tla."""
    nearest: str = ""
    """The nearest allowed behaviour, as text."""
    causes: tuple[str, ...] = ()
    """Inputs that would have led to the logged event."""
    state: str = ""
    """The state of the station before the event."""
    of_last_input: bool = True
    """Whether the last input could have led to the logged event, had a guard been different. If
    not, the rule that decided that input is not the cause."""

    def why(self) -> list[str]:
        """Why it is a problem, one fact per line."""
        found = [self.nearest] if self.nearest else []
        if self.causes:
            found.append(f"allowed after: {'; '.join(self.causes)}")
        return [*found, f"state before: {self.state}"] if self.state else found


NOTHING_WRONG = Finding("nothing")


def cannot_tell(file: str, line: int, why: str) -> Finding:
    """A finding for a log that is insufficient for a verdict."""
    return Finding("cannot_tell", at=Where(file, line), observed=why)


def unreadable(error: BadInput) -> Finding:
    """A finding for a file that cannot be read, from some line on."""
    return Finding("unreadable", at=Where(error.path, error.line, error.field), observed=error.what)


Seen = tuple[str, Fields | Timer | str]
"""``("send", message)``, ``("arm" | "stop" | "expire", timer)``, ``("indication", name)``,
``("phase", name)``."""


class Diverges(Exception):
    """The log diverges from the specification here. Its finding does not name the file yet.

    ``step`` is the step whose effects are not as expected, or None if no input calls for the event.
    ``seen`` is the observed event, or None if an effect is missing. ``mismatch`` is the number of
    fields in which a message differs from the expected one of its type, or 0 if none of its type is
    expected.
    """

    kind: Kind = "missing"

    def __init__(
        self,
        at: int,
        event: str,
        rule: str,
        wanted: Sequence[str],
        guard: str,
        step: InputStep | None = None,
        seen: Seen | None = None,
        mismatch: int = 0,
    ) -> None:
        super().__init__(event)
        kind = self.kind
        if seen is not None and kind == "missing":
            kind = "state" if seen[0] in ("phase", "role") else "unexpected"
        self.finding = Finding(kind, rule, "", Where("", at), tuple(wanted), event, guard)
        self.step, self.seen, self.mismatch = step, seen, mismatch
        self.missed = ""
        """The copy that is missing before a message that no input calls for, as text."""


class Late(Diverges):
    """An event that happens long after a timer should have expired."""

    kind = "overdue"
    message = ""
    """The type of the message that the timer would have sent again, if it is a resend timer."""


class Supposition(NamedTuple):
    """An unlogged restart, or an unlogged expiry that makes the application fall back."""

    what: str
    """``restart``, or the name of the timer."""
    after_line: int
    before_line: int
    """It happened between these lines."""

    def __str__(self) -> str:
        what = "it restarted" if self.what == "restart" else f"its {self.what} expired"
        return f"{what} unseen between lines {self.after_line} and {self.before_line}"
