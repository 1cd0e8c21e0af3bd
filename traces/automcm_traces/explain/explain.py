"""The verdict on a log: allowed, or its first divergence from the specification; and its text."""

from __future__ import annotations

import json
import shlex
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
from os.path import realpath
from pathlib import Path

from pydantic_core import to_json

from automcm_spec.log_format.event_text import plain, starts
from automcm_spec.log_format.log import OF_MESSAGE, OF_TIMER, Event, Header, Receive, Send, Timer
from automcm_spec.log_format.reader import Log, LogStream
from automcm_spec.support import files
from automcm_spec.support.bad_input import BadInput, at_line, name_of, printable
from automcm_spec.vocabulary.rules import RULES
from automcm_traces.checker.divergence import explained
from automcm_traces.checker.finding import (
    NOTHING_WRONG,
    Answer,
    Finding,
    Supposition,
    answer,
    cannot_tell,
    unreadable,
    worst,
)
from automcm_traces.checker.follow import Check, Watcher
from automcm_traces.checker.log_start import MID_SESSION
from automcm_traces.checker.possible_states import Possible
from automcm_traces.checker.track import InputStep, Track
from automcm_traces.explain.hints import Hints, Rejections, counted, ordered
from automcm_traces.explain.log_table import columns, rows_of
from automcm_traces.system.delivery import forged_receptions
from automcm_traces.system.log_merge import MergeError, merge
from automcm_traces.system.properties import SystemReport, judge, judge_merged
from automcm_traces.system.timeline import Recorder, Timeline

SESSIONS = 10
"""The maximum number of sessions shown; the last ones."""
MOST = 100
"""The maximum number of sessions kept, the last ones; the others are only counted."""


@dataclass(slots=True)
class OwnSession:
    """A session from the point of view of one station."""

    session: tuple[int, int]
    role: str
    first: int
    """The line of the input that began it."""
    phases: list[str]
    last: int = 0
    """The line of the input that ended it; 0 if the log ends first."""
    rule: str = ""
    """The rule that ended it."""

    def __str__(self) -> str:
        name = f"session {plain(self.session)} as {self.role}"
        way = " > ".join(self.phases)
        if not self.last:
            return f"{name}, from line {self.first}: {way}, still in it"
        why = RULES.get(self.rule, "")
        return f"{name}, lines {self.first} to {self.last}: {way}; ended by {self.rule}: {why}"


class OwnSessions(Watcher):
    """Collects the sessions of a station."""

    def __init__(self, most: int = MOST) -> None:
        self.kept: list[OwnSession] = []
        """The last ``most`` sessions."""
        self.number = 0
        self._most = most

    def step(self, step: InputStep, track: Track) -> None:
        """Update the sessions after a step."""
        if not step.moves:
            return
        current = self.kept[-1] if self.kept and not self.kept[-1].last else None
        if current is not None and current.session != track.session:
            current.last, current.rule = step.at, step.rule
            current = None
        if track.session is None:
            return
        if current is None:
            self.number += 1
            current = OwnSession(track.session, track.state.role, step.at, [])
            self.kept = [*self.kept[1 - self._most :], current]
        if current.phases[-1:] != [track.state.phase]:
            current.phases.append(track.state.phase)


@dataclass(frozen=True, slots=True)
class Verdict:
    """The verdict on one log."""

    file: str
    finding: Finding = NOTHING_WRONG
    """The problem, or why no verdict is possible."""
    possible_states: int = 1
    """The number of possible states of the specification before the event, or at the end."""
    events: int = 0
    warnings: tuple[str, ...] = ()
    """The problems that the reader ignored: an unknown event, an incomplete line, a missing end."""
    unobserved: tuple[str, ...] = ()
    """The event kinds that the log does not promise."""
    sessions: tuple[OwnSession, ...] = ()
    """The last sessions of the station, if the log determines its state."""
    number_of_sessions: int = 0
    header: Header | None = None
    recent: tuple[tuple[int, Event], ...] = ()
    """The last events up to the divergence, with their lines."""
    seen: int = 0
    """The last line checked: that of the divergence, or of the event that revealed it."""
    only_if: tuple[Supposition, ...] = ()
    """The unobserved events without which the log would not be allowed."""
    first_ms: int | None = None
    """The time of the first event; None if there is none."""
    judged_from: int = 0
    """The line of the first event that was judged, if the log begins in mid-session; else 0."""
    hint: str = ""
    """Why the log, and not the station, may be to blame, or why nobody answered; empty if nothing
    hints at it."""
    rejected: Mapping[str, int] = field(default_factory=dict)
    """How many datagrams the station's secured link discarded, by reason."""

    @property
    def verdict(self) -> Answer:
        """The verdict as one word."""
        return answer(self.finding.kind)

    def as_dict(self) -> dict[str, object]:
        """The ``--json`` form."""
        found = self.finding
        return {
            "verdict": self.verdict,
            "file": self.file,
            "line": found.at.line,
            "event": found.observed,
            "rule": found.rule,
            "expected": list(found.expected),
            "guard": found.guard,
            "of_last_input": found.of_last_input,
            "nearest": found.nearest,
            "allowed_after": list(found.causes),
            "state": found.state,
            "judged_from": self.judged_from,
            "hint": self.hint,
            "rejected": dict(self.rejected),
            "possible_states": self.possible_states,
            "only_if": [supposition._asdict() for supposition in self.only_if],
            "events": self.events,
            "sessions": list(map(asdict, self.sessions)),
            "number_of_sessions": self.number_of_sessions,
            "unobserved": list(self.unobserved),
            "warnings": list(self.warnings),
        }


def explain(
    log: Log | LogStream,
    late_ms: int | None = None,
    watchers: Sequence[Watcher] = (),
    events: Iterable[tuple[int, Event]] | None = None,
) -> Verdict:
    """The verdict on one log. The arguments are those of ``Check`` and its ``read``."""
    return VerdictCheck(log, late_ms, watchers).read(events).verdict()


class VerdictCheck(Check):
    """A check that also notes what a verdict says besides its result."""

    def __init__(
        self,
        log: Log | LogStream,
        late_ms: int | None = None,
        watchers: Sequence[Watcher] = (),
        most: int = MOST,
    ) -> None:
        """``most`` is the maximum number of sessions kept."""
        self._sessions, self._hints = OwnSessions(most), Hints(log.header)
        self._rejections = Rejections()
        noted = (self._sessions, self._hints, self._rejections)
        super().__init__(log, late_ms, [*noted, *watchers])

    def verdict(self) -> Verdict:
        """The verdict after the check."""
        log, sessions = self.log, self._sessions
        found, engine, diverges = self.finding, self.engine, self.diverges
        if not self.events and found.kind == "nothing":
            found = cannot_tell(log.file, 0, "the log contains no events")
        if diverges is not None and engine is not None:
            found = explained(found, diverges, engine.track)
        verdict = Verdict(
            log.file,
            found,
            events=self.events,
            warnings=tuple(log.warnings),
            unobserved=tuple(log.header.unobserved),
            header=log.header,
            first_ms=self.first_ms,
            judged_from=self.judged_from,
            hint="; ".join(filter(None, (self._hints.hint(self), *self._rejections.hints()))),
            rejected=ordered(self._rejections.reasons),
        )
        if engine is None or not self.decided:
            return verdict
        if isinstance(engine, Possible):
            only_if = () if diverges else engine.only_if
            verdict = replace(verdict, possible_states=engine.states, only_if=only_if)
        return replace(
            verdict,
            sessions=tuple(sessions.kept),
            number_of_sessions=sessions.number,
            recent=tuple(self.recent) if diverges else (),
            seen=self.line if diverges else 0,
        )


def forged(logs: Sequence[Log]) -> dict[str, Finding]:
    """By file: the first received message that differs from the message its sender logged under the
    same tx. The logs may be of several runs; those that cannot be merged are not compared."""
    runs: dict[str, list[Log]] = defaultdict(list)
    for log in logs:
        runs[log.header.run].append(log)
    found: dict[str, Finding] = {}
    for run in runs.values():
        with suppress(MergeError):
            found |= forged_receptions(merge(run))
    return found


@dataclass(slots=True)
class JudgedLog:
    """A file that was read and checked once."""

    path: Path
    verdict: Verdict
    log: Log | None = None
    """The readable part of the log; None if it has no header or is not kept."""
    complete: bool = False
    """Whether the whole log is readable."""
    timeline: Timeline | None = None
    refused: BadInput | None = None
    """The error, if the file is not a log."""


def judged_log(
    path: Path,
    late_ms: int | None = None,
    keep: bool = True,
    watchers: Sequence[Watcher] = (),
    known: dict[str, Send | Receive] | None = None,
) -> JudgedLog:
    """Read and check a file; with ``keep``, keep its events and its timeline, and take equal
    messages from ``known``: events of the logs before, by ``tx``."""
    try:
        stream = LogStream(path)
    except BadInput as error:
        return JudgedLog(path, Verdict(name_of(path), unreadable(error)), refused=error)
    if not keep:
        return JudgedLog(path, explain(stream, late_ms, watchers))
    recorder, events = Recorder(stream), list[tuple[int, Event]]()
    kept = _kept(stream, events, {} if known is None else known)
    verdict = explain(stream, late_ms, [recorder, *watchers], kept)
    return JudgedLog(path, verdict, stream.log(events), stream.complete, recorder.made)


def _kept(
    stream: LogStream, events: list[tuple[int, Event]], known: dict[str, Send | Receive]
) -> Iterator[tuple[int, Event]]:
    """The events of a log, which are kept; equal messages, ``tx`` and timers are in memory once."""
    timers: dict[Timer, Timer] = {}
    for line, event in stream:
        if isinstance(event, OF_MESSAGE) and event.tx and event.message:
            first = known.setdefault(event.tx, event)
            one, other = first.message, event.message
            both_cams = dict not in (type(one), type(other))  # CamFields have one order
            alike = first is not event and one == other
            if alike and (both_cams or to_json(one) == to_json(other)):
                object.__setattr__(event, "message", one)
                object.__setattr__(event, "tx", first.tx)
        elif isinstance(event, OF_TIMER):
            object.__setattr__(event, "timer", timers.setdefault(event.timer, event.timer))
        events.append((line, event))
        yield line, event


def judged_logs(paths: Sequence[Path], late_ms: int | None = None) -> list[JudgedLog]:
    """Read and check files. Several logs are kept, with equal messages in memory once."""
    known: dict[str, Send | Receive] = {}
    return [judged_log(path, late_ms, len(paths) > 1, known=known) for path in paths]


def verdict_of(path: Path, late_ms: int | None = None) -> Verdict:
    """The verdict on the log in a file of any length."""
    return judged_log(path, late_ms, keep=False).verdict


def verdicts_of(paths: Sequence[Path], late_ms: int | None = None) -> list[Verdict]:
    """A verdict for each file. With several files, received messages are compared with the sent
    ones."""
    return verdicts(judged_logs(paths, late_ms))


def verdicts(found: Sequence[JudgedLog]) -> list[Verdict]:
    """The verdicts; of several logs, one that received a forged message before any other problem
    diverges."""
    return _with_forged(found, forged(_complete_logs(found)))


def verdicts_together(found: Sequence[JudgedLog]) -> tuple[list[Verdict], SystemReport]:
    """The verdicts on the logs of one run, and the report on all together."""
    logs = _complete_logs(found)
    try:
        merged = merge(logs)
    except MergeError:
        return verdicts(found), judge(logs)
    timelines = {one.verdict.file: one.timeline for one in found if one.timeline is not None}
    parts = [one.verdict.file for one in found if one.log is not None and not one.complete]
    merged.notices += [f"{file}: not judged together: a part of it is missing" for file in parts]
    return _with_forged(found, forged_receptions(merged)), judge_merged(merged, timelines)


def _with_forged(found: Sequence[JudgedLog], foreign: Mapping[str, Finding]) -> list[Verdict]:
    verdicts = []
    for v in (one.verdict for one in found):
        other = foreign.get(v.file)
        if other is not None and (v.verdict == "allowed" or other.at.line <= v.finding.at.line):
            of_whole_log = ("warnings", "header", "first_ms", "hint", "rejected")
            v = Verdict(v.file, other, **{name: getattr(v, name) for name in of_whole_log})
        verdicts.append(v)
    return verdicts


def _complete_logs(found: Sequence[JudgedLog]) -> list[Log]:
    return [one.log for one in found if one.log is not None and one.complete]


def exit_code(verdicts: Sequence[Verdict], together: SystemReport | None = None) -> int:
    """The exit code for the most severe verdict, or for a property violated ``together``."""
    violated = together is not None and together.verdict == "violated"
    return 1 if violated else worst(v.verdict for v in verdicts)


# -- the verdict as text, the failing prefix, and the command to replay it


def start_times(verdicts: Iterable[Verdict]) -> dict[str, int]:
    """The time that counts as the start of each log, by file."""
    return starts({v.file: v.first_ms for v in verdicts if v.first_ms is not None})


def text(verdict: Verdict, start_ms: Mapping[str, int] | None = None) -> str:
    """The verdict as lines for a terminal, with the reader's warnings.

    ``start_ms`` has the time that counts as 0, by file; without it, times are as logged.
    """
    start = None if start_ms is None else start_ms.get(verdict.file, 0)
    lines = [*_lines(verdict, start), *_rejected(verdict)]
    lines += [f"  hint: {verdict.hint}"] if verdict.hint else []
    lines += [f"  warning: {warning}" for warning in verdict.warnings]
    return "\n".join(map(printable, lines))


def _rejected(verdict: Verdict) -> Iterator[str]:
    number = sum(verdict.rejected.values())
    if number and verdict.header is not None:
        messages = f"{number} message{'' if number == 1 else 's'}"
        station = verdict.header.station
        yield f"  station {station} rejected {messages}: {counted(verdict.rejected)}"


def _lines(verdict: Verdict, start_ms: int | None) -> Iterator[str]:
    found = verdict.finding
    where = at_line(verdict.file, found.at.line)
    match verdict.verdict:
        case "allowed":
            yield f"{verdict.file}: ALLOWED, {verdict.events} event{'s' * (verdict.events != 1)}"
            yield from _allowed(verdict)
        case "unreadable" | "cannot_tell" as word:
            yield f"{where}: {word.replace('_', ' ').upper()}: {found.observed}"
        case "diverges":
            yield f"{where}: DIVERGES at {found.observed}"
            if verdict.judged_from:
                yield f"  {MID_SESSION}; judged from line {verdict.judged_from} on"
            yield from _diverges(verdict, start_ms)


def _allowed(verdict: Verdict) -> Iterator[str]:
    if verdict.unobserved:
        kinds, n = ", ".join(verdict.unobserved), verdict.possible_states
        states = f"{n} state{'' if n == 1 else 's'} of the specification"
        yield f"  not logged: {kinds}; at its end the log fits {states}"
    suppositions = verdict.only_if[-SESSIONS:]
    if (number := len(verdict.only_if)) > len(suppositions):
        yield f"  allowed only if {number} unlogged events happened; the last of them:"
    yield from (f"  allowed only if {supposition}" for supposition in suppositions)
    shown = verdict.sessions[-SESSIONS:]
    if verdict.number_of_sessions > len(shown):
        yield f"  {verdict.number_of_sessions} sessions; the last of them:"
    yield from (f"  {session}" for session in shown)


def expected(these: Sequence[str]) -> list[str]:
    """The expected effects on one line, each message before its timers; no line if there are
    none."""
    return [f"expected: {'; '.join(these)}"] if these else []


def _diverges(verdict: Verdict, start_ms: int | None) -> Iterator[str]:
    found = verdict.finding
    yield from (f"  {line}" for line in expected(found.expected))
    if found.guard:
        by = "by" if found.of_last_input else "last input decided by"
        yield f"  {by} {found.guard}"
    yield from (f"  {line}" for line in found.why())
    n = verdict.possible_states
    if n != 1 or verdict.unobserved:
        yield f"  {n} state{'' if n == 1 else 's'} of the specification possible before"
    if verdict.sessions:
        yield f"  in {verdict.sessions[-1]}"
    if verdict.recent and verdict.header is not None:
        station = verdict.header.station
        rows = rows_of(station, verdict.recent)
        zero = None if start_ms is None else {station: start_ms}
        yield from (f"  {line}" for line in columns(rows, [station], 78, zero))


def prefix(
    verdict: Verdict, folder: Path, taken: Collection[Path] = (), log: Path | None = None
) -> Path:
    """Write the part of the log up to the divergence as a log of its own, which has the same
    verdict.

    It is none of the files ``taken``. ``log`` is the file to read, if it is not the one that the
    verdict names. Raises OSError.
    """
    lines = max(verdict.seen, verdict.finding.at.line)
    files.folder(folder, named=True)
    log = Path(verdict.file) if log is None else log
    name = f"{log.stem}-{verdict.finding.at.line}"
    path, n = folder / f"{name}.ndjson", 1
    others = set(map(realpath, taken))
    while realpath(path) in others:
        n += 1
        path = folder / f"{name}-{n}.ndjson"
    with open(log, "rb") as stream:
        kept = list(islice(stream, lines))
    last: dict[str, object] = json.loads(kept[-1])
    kept[-1] = kept[-1].removesuffix(b"\n") + b"\n"
    end = {"rec": "end", "seq": last["seq"], "reason": "prefix", "lost_records": 0}
    kept.append(json.dumps(end).encode() + b"\n")
    files.write(path, b"".join(kept))
    return path


def replay(path: Path) -> str:
    """The command that replays the inputs of a log against an implementation."""
    return f"automcm trace replay {shlex.quote(str(path))} -- YOUR_ADAPTER"
