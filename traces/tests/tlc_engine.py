"""The independent judge: TLC checks logs on ``TraceCheck.tla``, thousands in one run.

It shares only the reader and the table of the compared fields with ``engine.py``. Station.tla
itself decides, with its limits (MEM-1) and the real stations, not a graph of one or two peers.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tlc_module import TooLarge, Translation, limits, module

from automcm_spec.log_format.log import Event, Send, problems
from automcm_spec.log_format.reader import Log, LogStream
from automcm_spec.model_checking import tlc
from automcm_spec.support import scratch
from automcm_spec.support.bad_input import BadInput, name_of
from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary.parameters import LIMITS
from automcm_traces.checker.finding import Finding, Where, cannot_tell, unreadable
from automcm_traces.checker.log_start import MID_SESSION
from automcm_traces.explain.explain import Verdict

Json = Any
NEEDED = ("receive", "send")
"""The event kinds that a log must promise; TLC guesses the other missing events."""
BATCH = 100_000
"""The maximum number of events in one run of TLC, which keeps them in memory."""
_MODULES = ("Station.tla", "TraceCheck.tla")
_CONSTANTS = {
    "max_rounds": "MaxRounds",
    "max_participants": "MaxParticipants",
    "outbox_limit": "OutboxLimit",
    "memory_limit": "MemoryLimit",
}


def explain_batch(logs: Sequence[Log], late_ms: int | None = None) -> list[Verdict]:
    """The verdict on each log. ``late_ms`` is as for ``Engine``, in milliseconds.

    Runs TLC once for each set of limits in the headers, and for every 100,000 events. Raises
    automcm_spec.model_checking.tlc.TlcError if TLC is missing or fails.
    """
    verdicts: dict[int, Verdict] = {}
    groups: dict[tuple[int, ...], list[tuple[int, Translation]]] = {}
    for n, log in enumerate(logs):
        problem = _beyond(log)
        try:
            if not problem:
                group = groups.setdefault(limits(log), [])
                group.append((n, Translation(log, late_ms)))
        except TooLarge as error:
            problem = str(error)
        if problem:
            verdicts[n] = Verdict(log.file, cannot_tell(log.file, 0, problem), header=log.header)
    for constants, group in groups.items():
        for batch in _batches(group, logs):
            answers = _run(constants, [translation for _, translation in batch])
            for (n, _), answer in zip(batch, answers, strict=True):
                verdicts[n] = _verdict(logs[n], answer)
    return [verdicts[n] for n in range(len(logs))]


def explain_each(paths: Sequence[Path], late_ms: int | None = None) -> list[Verdict]:
    """A verdict for each file on its own. The files need not be of one run and are not compared."""
    found: dict[Path, Verdict] = {}
    logs: dict[Path, Log] = {}
    for path in paths:
        try:
            logs[path], problem = _readable_part(LogStream(path))
        except BadInput as error:
            problem = Verdict(name_of(path), unreadable(error))
        if problem is not None:
            found[path] = problem
    for path, verdict in zip(logs, explain_batch(list(logs.values()), late_ms), strict=True):
        if path not in found or verdict.verdict in ("diverges", "unreadable"):
            found[path] = verdict
        found[path] = replace(
            found[path], warnings=tuple(logs[path].warnings), header=verdict.header
        )
    return [found[path] for path in paths]


def _readable_part(stream: LogStream) -> tuple[Log, Verdict | None]:
    """The readable part of a log, and a verdict if there is an unreadable rest."""
    events: list[tuple[int, Event]] = []
    problem: Verdict | None = None
    try:
        events.extend(stream)
    except BadInput as error:
        problem = Verdict(stream.file, unreadable(error))
    if problem is None and stream.gap is not None:
        line, what = stream.gap
        text = f"records are missing before this line: {what}"
        problem = Verdict(stream.file, cannot_tell(stream.file, line, text))
    return stream.log(events), problem


def _beyond(log: Log) -> str:
    """Why TLC cannot check this log; empty if it can."""
    if log.end is not None and log.end.lost_records:
        return f"the log lost {log.end.lost_records} records"
    if not log.events:
        return "the log contains no events"
    if log.mid_session:
        return MID_SESSION
    missing = [kind for kind in NEEDED if kind not in log.header.complete]
    return f"`complete` in the header lacks {', '.join(missing)}" if missing else ""


def _batches(
    group: Sequence[tuple[int, Translation]], logs: Sequence[Log]
) -> Iterable[list[tuple[int, Translation]]]:
    batch: list[tuple[int, Translation]] = []
    size = 0
    for n, translation in group:
        size += len(logs[n].events)
        if batch and size > BATCH:
            yield batch
            batch, size = [], len(logs[n].events)
        batch.append((n, translation))
    if batch:
        yield batch


def _run(constants: Sequence[int], translations: Sequence[Translation]) -> list[Json]:
    """TLC's answer for each log: ``[what, line, rule]``."""
    best: dict[int, Json] = {}

    def take(text: str) -> None:
        what, log, line, rule, _ = _untla(text)
        before = best.get(log)
        if before is None or what == "ALLOWED" or (before[0] != "ALLOWED" and line > before[1]):
            best[log] = [what, line, rule]

    with scratch.folder("traces") as folder:
        for file in _MODULES:
            shutil.copy(TLA / file, folder)
        text = module("Batch", [t.text for t in translations])
        (folder / "Batch.tla").write_text(text, encoding="utf-8")
        cfg = folder / "Batch.cfg"
        values = dict(zip(LIMITS, constants, strict=True))
        lines = [f"{_CONSTANTS[name]} = {value}" for name, value in values.items()]
        cfg.write_text(
            "\n".join(["CONSTANTS", *lines, "Logs <- TheLogs", "INIT Init", "NEXT Next"])
            + "\nCHECK_DEADLOCK FALSE\n",
            encoding="utf-8",
        )
        tlc.run("Batch", cfg, tla_dir=folder, short=True, on_print=take)
    return [best[n] for n in range(1, len(translations) + 1)]


def _untla(line: str) -> Json:
    """A line of PrintT(ToString(tuple)) as JSON: tuples and sets become lists."""
    text = line[1:-1].replace('\\"', '"')
    for old, new in (("<<", "["), (">>", "]"), ("{", "["), ("}", "]")):
        text = text.replace(old, new)
    return json.loads(text.replace("TRUE", "true").replace("FALSE", "false"))


def _verdict(log: Log, answer: Json) -> Verdict:
    what, line, rule = answer
    if what == "ALLOWED":
        return Verdict(log.file, header=log.header, events=len(log.events))
    event = dict(log.events).get(line)
    if rule == "ACT-5" and isinstance(event, Send) and event.is_cam and problems(event.message):
        rule = "END-5"  # TraceCheck.tla has no malformed CAM: it is one of no station
    found = Finding("unexpected", rule, "", Where(log.file, line))
    return Verdict(log.file, found, header=log.header, events=len(log.events))
