"""What is wrong, as a value: texts, JSON and exit codes are made of it where they are printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

from automcm_spec.support.bad_input import BadInput
from automcm_spec.vocabulary.messages import Fields
from automcm_traces.checker.track import Step
from automcm_traces.format.log import Timer

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
"""``missing``: not all that an input calls for followed.  ``unexpected``: something that nothing
called for, or not in this form.  ``state``: another phase or role.  ``overdue``: a timer did not
expire.  ``forged``: received, and not what its sender sent.  ``property``: one of the system
(S-*, T-*).  ``format``: a check of lint."""


class At(NamedTuple):
    """A place in a file; line 0 is all of it, an empty field is the whole line."""

    file: str = ""
    line: int = 0
    field: str = ""


NOWHERE = At()


@dataclass(frozen=True, slots=True)
class Why:
    """What decided, and what would have been allowed instead; texts for a person, empty where
    nothing is known."""

    guard: str = ""
    """The rule, what it says, and where it stands."""
    nearest: str = ""
    causes: tuple[str, ...] = ()
    """Inputs that would have led to what the log says."""
    state: str = ""
    """The station before the event."""
    of_last_input: bool = True
    """Whether the last input leads to what the log says, but for a guard.  If not, the rule that
    decided it has nothing to do with that."""

    def as_dict(self) -> dict[str, object]:
        """As in ``--json``."""
        return {"nearest": self.nearest, "causes": list(self.causes), "state": self.state}

    def lines(self) -> list[str]:
        """One thing a line."""
        found = [self.nearest] if self.nearest else []
        if self.causes:
            found.append(f"allowed after: {'; '.join(self.causes)}")
        return [*found, f"state before: {self.state}"] if self.state else found


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong."""

    kind: Kind
    rule: str = ""
    """Of docs/protocol.md; of a ``format``, the check."""
    property: str = ""
    at: At = NOWHERE
    expected: tuple[str, ...] = ()
    observed: str = ""
    """What there is instead, in words."""
    why: Why = field(default_factory=Why)


NOTHING_WRONG = Finding("nothing")


def cannot_tell(file: str, line: int, why: str) -> Finding:
    """It is not known whether anything is wrong."""
    return Finding("cannot_tell", at=At(file, line), observed=why)


def unreadable(error: BadInput) -> Finding:
    """A file cannot be read, from some line on."""
    return Finding("unreadable", at=At(error.path, error.line, error.field), observed=error.what)


Seen = tuple[str, Fields | Timer | str]
"""``("send", message)``, ``("arm" | "stop" | "expire", timer)``, ``("indication", name)``,
``("phase", name)``."""


class Diverges(Exception):
    """The log leaves the specification here: the finding, without its file.

    ``step`` is the step that did not go on as it must, None if nothing called for anything, and
    ``seen`` what the log has instead, None if something is missing.  ``off`` says of a message of
    which another form was called for in how many fields it is not that; 0 if none was.
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
        seen: Seen | None = None,
        off: int = 0,
    ) -> None:
        super().__init__(event)
        found = Finding(self.kind, rule, "", At("", at), tuple(wanted), event, Why(guard))
        if seen is not None and self.kind == "missing":
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

    def as_dict(self) -> dict[str, object]:
        """As in ``--json``."""
        return {"what": self.what, "after_line": self.after, "before_line": self.before}
