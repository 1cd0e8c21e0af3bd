"""Errors in input files, and how messages name their place."""

from __future__ import annotations

from pathlib import Path, PosixPath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import ValidationError


class SpooledInput(PosixPath):
    """A file that messages name ``given``, such as a temporary copy of a pipe."""

    given = ""


class BadInput(Exception):
    """Input that breaks its format; the text is one line with file, line, field and rule.

    It is the only exception that blames the user's file. Any other exception is a fault of AutoMCM
    (exit code 70).

    `line` is 0 for the whole file, `field` is "" for a whole line. `rule` names the rule of the
    format; for a log it is one of ``automcm_traces.explain.lint.CHECKS``. It is "" if the file has
    no such format or cannot be opened.
    """

    def __init__(
        self, path: str | Path, line: int, field: str, problem: str, rule: str = ""
    ) -> None:
        self.path = name_of(path)
        self.line = line
        self.field = field
        self.problem = problem
        self.rule = rule
        self.where = one_line(at_line(self.path, line))
        """The file, and the line if there is one."""
        named = one_line(f"{field}: {problem}" if field else problem)
        self.what = f"{named} [{rule}]" if rule else named
        """The field if there is one, the problem, and the rule."""
        super().__init__(f"{self.where}: {self.what}")


def name_of(path: str | Path) -> str:
    """The name of a file in messages."""
    return path.given if isinstance(path, SpooledInput) else str(path)


def at_line(file: str, line: int) -> str:
    """FILE:LINE, or only the file if the line is 0."""
    return f"{file}:{line}" if line else file


def errors_of(error: ValidationError) -> list[tuple[str, str]]:
    """Each error of pydantic: the path of the field, such as ``vectors.3.id``, and the problem."""
    found = error.errors(include_url=False, include_input=False)
    return [(".".join(map(str, each["loc"])), each["msg"]) for each in found]


def printable(text: str, keep: str = "") -> str:
    """`text` with escapes for unprintable characters (controls, marks of direction, surrogates),
    except those in ``keep``."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else ascii(c)[1:-1] for c in text)


def one_line(text: str) -> str:
    """`text` with escapes for unprintable characters, cut after 1000 characters."""
    safe = printable(text)
    return safe if len(safe) <= 1000 else safe[:1000] + "..."
