"""What a log means: allowed by the specification, or where it first leaves it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from automcm_traces.engine import Diverges, Engine
from automcm_traces.log import Receive, Send
from automcm_traces.possible import Possible
from automcm_traces.reader import Log, LogError, read
from automcm_traces.track import CannotTell

Json = Any
NEEDED = ("command", "receive", "restart", "send", "timer")
"""Kinds of event with all of which a log says what the one state of its station is."""


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
        whole = set(NEEDED) <= set(log.header.complete)
        engine = Engine(log, late_ms) if whole else Possible(log, late_ms)
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
    sent: dict[str, dict[str, Json]] = {}
    stations = {log.header.station for log in logs if "send" in log.header.complete}
    for log in logs:
        sent |= {e.tx: e.message for _, e in log.events if isinstance(e, Send)}
    found: dict[str, Verdict] = {}
    for log in logs:
        for at, e in log.events:
            if not isinstance(e, Receive) or e.tx is None or e.message is None:
                continue
            original = sent.get(e.tx)
            if original == e.message or int(e.tx.split(":")[0]) not in stations:
                continue
            what = f"receive {e.message['type']} {e.tx}: not what its sender sent"
            found[log.file] = Verdict("diverges", log.file, at, what, "forged", (str(original),))
            break
    return found


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
