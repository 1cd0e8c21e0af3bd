"""What a log means: allowed by the specification, or where it first leaves it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from automcm_spec.bad_input import BadInput, name_of
from automcm_traces.delivery import forged_receptions
from automcm_traces.divergence import why
from automcm_traces.finding import NOTHING_WRONG, At, Finding, Kind, cannot_tell, unreadable
from automcm_traces.follow import Watcher, follow
from automcm_traces.log import Event, Header
from automcm_traces.properties import SystemReport, judge
from automcm_traces.reader import Log, LogStream
from automcm_traces.same import same
from automcm_traces.sessions import Session, Sessions
from automcm_traces.step import Supposition
from automcm_traces.timeline import Recorder, Timeline

Json = Any
Answer = Literal["allowed", "diverges", "cannot_tell", "unreadable"]
ANSWERS: dict[Kind, Answer] = {
    "nothing": "allowed",
    "cannot_tell": "cannot_tell",
    "unreadable": "unreadable",
}
"""By what was found; anything else is a divergence."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The answer to one question: was it allowed?"""

    file: str
    finding: Finding = NOTHING_WRONG
    """What is wrong, or why that is not known."""
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
    only_if: tuple[Supposition, ...] = ()
    """What must have happened unseen for the log to be allowed."""

    @property
    def verdict(self) -> Answer:
        """In a word."""
        return ANSWERS.get(self.finding.kind, "diverges")

    def as_dict(self) -> dict[str, Json]:
        """As in ``--json``."""
        found = self.finding
        return {
            "verdict": self.verdict,
            "file": self.file,
            "line": found.at.line,
            "event": found.observed,
            "rule": found.rule,
            "expected": list(found.expected),
            "guard": found.why.guard,
            "nearest": found.why.nearest,
            "allowed_after": list(found.why.causes),
            "state": found.why.state,
            "possible_states": self.possible_states,
            "only_if": [supposition.as_dict() for supposition in self.only_if],
            "events": self.events,
            "sessions": [session.as_dict() for session in self.sessions],
            "unobserved": list(self.unobserved),
            "warnings": list(self.warnings),
        }


def explain(
    log: Log | LogStream,
    late_ms: int | None = None,
    watchers: Sequence[Watcher] = (),
    events: Iterable[tuple[int, Event]] | None = None,
) -> Verdict:
    """The verdict on one log; the arguments are those of ``follow``."""
    sessions = Sessions()
    ending = follow(log, late_ms, [sessions, *watchers], events=events)
    found, engine, diverges = ending.finding, ending.engine, ending.diverges
    if not ending.events and found.kind == "nothing":
        found = cannot_tell(log.file, 0, "the log holds no event")
    if diverges is not None and engine is not None:
        found = replace(found, why=why(diverges, engine.track))
    verdict = Verdict(
        log.file,
        found,
        events=ending.events,
        warnings=tuple(log.warnings),
        unobserved=tuple(log.header.unobserved),
        header=log.header,
    )
    if engine is None or not ending.followed:
        return verdict
    return replace(
        verdict,
        possible_states=engine.states,
        sessions=tuple(sessions.kept),
        number_of_sessions=sessions.number,
        recent=tuple(ending.recent) if diverges else (),
        seen=ending.line if diverges else 0,
        only_if=() if diverges else engine.only_if,
    )


def forged(logs: Sequence[Log]) -> dict[str, Finding]:
    """By file: the first message received that is not the one its sender logged under that id."""
    return {
        file: Finding(
            "forged",
            "forged",
            at=At(file, at),
            expected=tuple(_as_sent(original, e.message or {})) if original else (),
            observed=f"receive {e.message and e.message['type']} {e.tx}: not what its sender sent",
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


@dataclass(slots=True)
class Explained:
    """A file, read and followed once."""

    path: Path
    verdict: Verdict
    log: Log | None = None
    """Up to where it can be read; None if it has no header, or is not kept."""
    whole: bool = False
    """All of it can be read."""
    timeline: Timeline | None = None
    refused: BadInput | None = None
    """Why it is no log at all."""


def explained(
    path: Path, late_ms: int | None = None, keep: bool = True, watchers: Sequence[Watcher] = ()
) -> Explained:
    """Read a file and follow it; ``keep`` its events and its timeline."""
    try:
        stream = LogStream(path)
    except BadInput as error:
        return Explained(path, Verdict(name_of(path), unreadable(error)), refused=error)
    if not keep:
        return Explained(path, explain(stream, late_ms, watchers))
    recorder, events = Recorder(stream), list[tuple[int, Event]]()
    verdict = explain(stream, late_ms, [recorder, *watchers], _kept(stream, events))
    return Explained(path, verdict, stream.log(events), stream.whole, recorder.made)


def _kept(stream: LogStream, events: list[tuple[int, Event]]) -> Iterator[tuple[int, Event]]:
    for event in stream:
        events.append(event)
        yield event


def explain_file(path: Path, late_ms: int | None = None) -> Verdict:
    """The verdict on the log in a file, however long."""
    return explained(path, late_ms, keep=False).verdict


def explain_files(paths: Sequence[Path], late_ms: int | None = None) -> list[Verdict]:
    """A verdict for each file; with several, messages are compared with what was sent."""
    return verdicts([explained(path, late_ms, keep=len(paths) > 1) for path in paths])


def verdicts(found: Sequence[Explained]) -> list[Verdict]:
    """With several logs, those in which a message is forged before anything else is wrong too."""
    return with_forged([one.verdict for one in found], _whole(found))


def with_forged(verdicts: Sequence[Verdict], logs: Sequence[Log]) -> list[Verdict]:
    """The verdicts on logs by themselves, and on what they received of one another."""
    foreign = forged(logs)
    return [
        Verdict(v.file, other, warnings=v.warnings, header=v.header)
        if (other := foreign.get(v.file)) is not None
        and (v.verdict == "allowed" or other.at.line <= v.finding.at.line)
        else v
        for v in verdicts
    ]


def together(found: Sequence[Explained]) -> SystemReport:
    """What the logs of one run say together; one that cannot be read is left out."""
    timelines = {one.verdict.file: one.timeline for one in found if one.timeline is not None}
    return judge(_whole(found), timelines)


def _whole(found: Sequence[Explained]) -> list[Log]:
    return [one.log for one in found if one.log is not None and one.whole]


EXIT: dict[Answer, int] = {"allowed": 0, "diverges": 1, "unreadable": 3, "cannot_tell": 4}


def exit_code(verdicts: Sequence[Verdict]) -> int:
    """Of several verdicts the one that weighs most: diverges, unreadable, cannot tell."""
    codes = Counter(EXIT[v.verdict] for v in verdicts)
    return next((code for code in (1, 3, 4) if codes[code]), 0)
