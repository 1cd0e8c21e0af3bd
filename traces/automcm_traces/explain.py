"""What a log means: allowed by the specification, or where it first leaves it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from automcm_traces.delivery import forged_receptions
from automcm_traces.engine import Diverges, Engine
from automcm_traces.reader import Log, LogError, read
from automcm_traces.track import CannotTell

Json = Any


@dataclass(frozen=True, slots=True)
class Verdict:
    """The answer to one question: was it allowed?"""

    verdict: Literal["allowed", "diverges", "cannot_tell", "unreadable"]
    file: str
    line: int = 0
    event: str = ""
    rule: str = ""
    expected: tuple[str, ...] = ()
    guard: str = ""
    possible_states: int = 1
    events: int = 0
    warnings: tuple[str, ...] = ()
    """What the reader had to overlook: an unknown event, a cut line, a missing end."""

    def as_dict(self) -> dict[str, Json]:
        return {
            "verdict": self.verdict,
            "file": self.file,
            "line": self.line,
            "event": self.event,
            "rule": self.rule,
            "expected": list(self.expected),
            "guard": self.guard,
            "possible_states": self.possible_states,
            "warnings": list(self.warnings),
        }


def explain(log: Log, late_ms: int | None = None) -> Verdict:
    """The verdict on one log; ``late_ms`` is as for ``Engine``.

    Raises automcm_spec.oracle.OracleError if there is no oracle.
    """
    at = 0
    try:
        if log.end is not None and log.end.lost_records:
            raise CannotTell(f"the log lost {log.end.lost_records} records")
        if not log.events:
            raise CannotTell("the log holds no event")
        engine = Engine(log, late_ms)
        for at, event in log.events:
            engine.feed(at, event)
        if log.ended:
            engine.finish()
    except Diverges as d:
        return Verdict("diverges", log.file, d.at, d.event, d.rule, tuple(d.wanted), d.guard)
    except CannotTell as error:
        return Verdict("cannot_tell", log.file, at, str(error))
    except (KeyError, TypeError, IndexError, ValueError) as error:
        text = f"a message lacks or misuses a field: {error}"
        return Verdict("unreadable", log.file, at, text)
    return Verdict("allowed", log.file, events=len(log.events))


def forged(logs: Sequence[Log]) -> dict[str, Verdict]:
    """By file: the first message received that is not the one its sender logged under that id."""
    return {
        file: Verdict(
            "diverges",
            file,
            at,
            f"receive {e.message and e.message['type']} {e.tx}: not what its sender sent",
            "forged",
            (str(original),),
        )
        for file, (at, e, original) in forged_receptions(logs).items()
    }


def explain_files(paths: Sequence[Path], late_ms: int | None = None) -> list[Verdict]:
    """A verdict for each file; with several, messages are compared with what was sent."""
    verdicts: dict[str, Verdict] = {}
    logs: list[Log] = []
    for path in paths:
        try:
            logs.append(read(path))
        except LogError as error:
            verdicts[str(path)] = Verdict("unreadable", str(path), error.line, str(error))
    foreign = forged(logs)
    for log in logs:
        verdict = explain(log, late_ms)
        other = foreign.get(log.file)
        if other is not None and (verdict.verdict == "allowed" or other.line <= verdict.line):
            verdict = other
        verdicts[log.file] = replace(verdict, warnings=tuple(log.warnings))
    return [verdicts[str(path)] for path in paths]


EXIT = {"allowed": 0, "diverges": 1, "unreadable": 3, "cannot_tell": 4}


def exit_code(verdicts: Sequence[Verdict]) -> int:
    """Of several verdicts the one that weighs most: diverges, unreadable, cannot tell."""
    codes = Counter(EXIT[v.verdict] for v in verdicts)
    return next((code for code in (1, 3, 4) if codes[code]), 0)


def text(verdict: Verdict) -> str:
    """A verdict for a person, with what the reader had to overlook."""
    return "\n".join([_text(verdict), *(f"  warning: {warning}" for warning in verdict.warnings)])


def _text(verdict: Verdict) -> str:
    if verdict.verdict == "allowed":
        return f"{verdict.file}: ALLOWED, {verdict.events} events"
    if verdict.verdict == "unreadable":
        return f"UNREADABLE  {verdict.event}"
    where = f"{verdict.file}:{verdict.line}"
    if verdict.verdict == "cannot_tell":
        return f"{where}: CANNOT TELL: {verdict.event}"
    lines = [f"{where}: DIVERGES at {verdict.event}"]
    lines += [f"  expected one of: {'; '.join(verdict.expected)}"] if verdict.expected else []
    lines += [f"  by {verdict.guard}"] if verdict.guard else []
    return "\n".join(lines)
