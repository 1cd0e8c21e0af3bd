"""What a log means: allowed by the specification, or where it first leaves it."""

from __future__ import annotations

import json
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from automcm_traces.delivery import forged_receptions
from automcm_traces.divergence import why
from automcm_traces.engine import Engine
from automcm_traces.log import Event, Header
from automcm_traces.properties import SystemReport, judge
from automcm_traces.reader import Log, LogError, LogStream, name_of, one_line, read
from automcm_traces.same import same
from automcm_traces.sessions import Session, Sessions
from automcm_traces.step import Diverges, Supposition, Why
from automcm_traces.track import CannotTell

if TYPE_CHECKING:
    from automcm_traces.possible import Possible

Json = Any
NEEDED = ("command", "receive", "restart", "send", "timer")
"""Kinds of event with all of which a log says what the one state of its station is."""
RECENT = 8
"""Events before a divergence that are shown."""


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
    """States of the specification that were possible before the event, or at the end."""
    events: int = 0
    warnings: tuple[str, ...] = ()
    """What the reader had to overlook: an unknown event, a cut line, a missing end."""
    unobserved: tuple[str, ...] = ()
    """Kinds of event that the log does not promise to hold."""
    sessions: tuple[Session, ...] = ()
    """The last sessions of the station, if the log says what it does."""
    number_of_sessions: int = 0
    header: Header | None = None
    recent: tuple[tuple[int, Event], ...] = ()
    """The last events up to the divergence, with their lines."""
    seen: int = 0
    """The last line that was read: that of the divergence, or of the event that showed it."""
    why: Why = field(default_factory=Why)
    only_if: tuple[Supposition, ...] = ()
    """What must have happened unseen for the log to be allowed."""

    def as_dict(self) -> dict[str, Json]:
        """As in ``--json``."""
        return {
            "verdict": self.verdict,
            "file": self.file,
            "line": self.line,
            "event": self.event,
            "rule": self.rule,
            "expected": list(self.expected),
            "guard": self.guard,
            "nearest": self.why.nearest,
            "allowed_after": list(self.why.causes),
            "state": self.why.state,
            "possible_states": self.possible_states,
            "only_if": [supposition.as_dict() for supposition in self.only_if],
            "events": self.events,
            "sessions": [session.as_dict() for session in self.sessions],
            "unobserved": list(self.unobserved),
            "warnings": list(self.warnings),
        }


def explain(log: Log | LogStream, late_ms: int | None = None) -> Verdict:
    """The verdict on one log; ``late_ms`` is as for ``Engine``.  Of a LogStream no more than the
    last events is kept in memory.
    """
    verdict = _judged(log, late_ms)
    if isinstance(log, LogStream):
        _read_to_the_end(log)
    lost = log.end.lost_records if log.end is not None else 0
    if lost and verdict.verdict in ("allowed", "diverges"):
        but = f"; but for that: {verdict.event}" if verdict.verdict == "diverges" else ""
        text = f"the log lost {lost} records{but}"
        verdict = replace(verdict, verdict="cannot_tell", event=text)
    return replace(verdict, warnings=tuple(log.warnings), header=log.header)


def _judged(log: Log | LogStream, late_ms: int | None) -> Verdict:
    missing, sessions = tuple(log.header.unobserved), Sessions()
    about: dict[str, Any] = {"unobserved": missing}
    recent: deque[tuple[int, Event]] = deque(maxlen=RECENT)
    at = events = states = 0
    try:
        follow = _follower(log.header, late_ms, sessions)
    except CannotTell as error:
        return Verdict("cannot_tell", log.file, 1, str(error), **about)
    try:
        for at, event in _events(log):
            events += 1
            recent.append((at, event))
            states = follow.states
            follow.feed(at, event)
        if isinstance(log, LogStream) and log.gap is not None:
            at, missing_records = log.gap
            raise CannotTell(f"records are missing before this line: {missing_records}")
        if not at:
            raise CannotTell("the log holds no event")
        if log.ended:
            follow.finish()
        states = follow.states
    except Diverges as d:
        wanted = tuple(d.wanted)
        return Verdict(
            "diverges",
            log.file,
            d.at,
            d.event + _late(at, recent[-1][1].late_ms),
            d.rule,
            wanted,
            d.guard,
            states,
            events,
            sessions=tuple(sessions.kept),
            number_of_sessions=sessions.number,
            recent=tuple(recent),
            seen=at,
            why=why(d, follow.track),
            **about,
        )
    except CannotTell as error:
        return Verdict("cannot_tell", log.file, at, str(error), events=events, **about)
    except LogError as error:
        return Verdict("unreadable", log.file, error.line, error.what, events=events, **about)
    except (KeyError, TypeError, IndexError, ValueError, AttributeError) as error:
        text = one_line(f"a message lacks or misuses a field: {error}")
        return Verdict("unreadable", log.file, at, text, events=events, **about)
    return Verdict(
        "allowed",
        log.file,
        possible_states=states,
        only_if=follow.only_if,
        events=events,
        sessions=tuple(sessions.kept),
        number_of_sessions=sessions.number,
        **about,
    )


def _late(line: int, ms: int | None) -> str:
    return f"; the station says that it was {ms} ms late (late_ms, line {line})" if ms else ""


def _follower(header: Header, late_ms: int | None, sessions: Sessions) -> Engine | Possible:
    if set(NEEDED) <= set(header.complete):
        engine = Engine(header, late_ms)
        engine.observer = sessions
        return engine
    from automcm_traces.possible import Possible

    return Possible(header, late_ms)


def _events(log: Log | LogStream) -> Iterator[tuple[int, Event]]:
    return iter(log) if isinstance(log, LogStream) else iter(log.events)


def _read_to_the_end(log: LogStream) -> None:
    """What the log says of itself at its end counts for the whole of it."""
    try:
        for _ in log:
            pass
    except LogError:
        pass  # it has been told, or comes after the divergence


def forged(logs: Sequence[Log]) -> dict[str, Verdict]:
    """By file: the first message received that is not the one its sender logged under that id."""
    return {
        file: Verdict(
            "diverges",
            file,
            at,
            f"receive {e.message and e.message['type']} {e.tx}: not what its sender sent",
            "forged",
            tuple(_as_sent(original, e.message or {})) if original else (),
        )
        for file, (at, e, original) in forged_receptions(logs).items()
    }


def _as_sent(original: dict[str, Json], m: dict[str, Json]) -> Iterator[str]:
    """Each field in which a message is not the one that was sent."""
    for name in sorted(original.keys() | m.keys()):
        was, is_ = original.get(name), m.get(name)
        if not same(was, is_):
            yield f"{name}: {_json(was)} was sent, not {_json(is_)}"


def _json(value: Json) -> str:
    return "nothing" if value is None else json.dumps(value)


def explain_file(path: str | Path, late_ms: int | None = None) -> Verdict:
    """The verdict on the log in a file, however long."""
    try:
        log = LogStream(path)
    except LogError as error:
        return Verdict("unreadable", name_of(path), error.line, error.what)
    return explain(log, late_ms)


def explain_files(paths: Sequence[Path], late_ms: int | None = None) -> list[Verdict]:
    """A verdict for each file; with several, messages are compared with what was sent."""
    verdicts = [explain_file(path, late_ms) for path in paths]
    if len(paths) == 1:
        return verdicts
    logs: list[Log] = []
    for path in paths:
        try:
            logs.append(read(path))
        except LogError:
            continue  # its verdict says so
    foreign = forged(logs)
    for n, verdict in enumerate(verdicts):
        other = foreign.get(verdict.file)
        if other is not None and (verdict.verdict == "allowed" or other.line <= verdict.line):
            verdicts[n] = replace(other, warnings=verdict.warnings, header=verdict.header)
    return verdicts


def together(paths: Sequence[Path]) -> SystemReport:
    """What the logs of one run say together; one that cannot be read is left out."""
    logs = []
    for path in paths:
        try:
            logs.append(read(path))
        except LogError:
            continue  # its own verdict says so
    return judge(logs)


EXIT = {"allowed": 0, "diverges": 1, "unreadable": 3, "cannot_tell": 4}


def exit_code(verdicts: Sequence[Verdict]) -> int:
    """Of several verdicts the one that weighs most: diverges, unreadable, cannot tell."""
    codes = Counter(EXIT[v.verdict] for v in verdicts)
    return next((code for code in (1, 3, 4) if codes[code]), 0)
