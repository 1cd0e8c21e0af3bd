"""What is wrong with a file of the user's, and how messages name its place."""

from pathlib import Path, PosixPath


class Kept(PosixPath):
    """A file that keeps input that cannot be read again, or that was not a file: messages name it
    as ``given``, and never the file."""

    given = ""


class BadInput(Exception):
    """Input that breaks its format; the text is one line and names file, line, field and rule.

    The only exception that blames the user's file. Anything else that is raised is a fault of
    AutoMCM (exit code 70).

    `line` is 0 if the whole file is meant, `field` is "" if a whole line is. `rule` names the rule
    of the format, in a log one of ``automcm_traces.explain.lint.CHECKS``; it is "" if the file has
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
        """The file, and the line if one is meant."""
        named = one_line(f"{field}: {problem}" if field else problem)
        self.what = f"{named} [{rule}]" if rule else named
        """The field, if one is meant, what is wrong there, and the rule."""
        super().__init__(f"{self.where}: {self.what}")


def name_of(path: str | Path) -> str:
    """How messages name a file."""
    return path.given if isinstance(path, Kept) else str(path)


def at_line(file: str, line: int) -> str:
    """FILE:LINE, or the file alone if no line is meant (0)."""
    return f"{file}:{line}" if line else file


def printable(text: str) -> str:
    """`text` with control characters and the like escaped."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def one_line(text: str) -> str:
    """`text` with control characters and the like escaped, and not longer than a screen's worth."""
    safe = printable(text)
    return safe if len(safe) <= 1000 else safe[:1000] + "..."
