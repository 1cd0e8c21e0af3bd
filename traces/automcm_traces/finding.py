"""What is wrong, as a value: texts, JSON and exit codes are made of it where they are printed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

from automcm_spec.bad_input import BadInput

Json = Any
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

    def as_dict(self) -> dict[str, Json]:
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
