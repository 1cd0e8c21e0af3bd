"""The files of a run: logs in the trace format, and files that replay an exchange."""

from __future__ import annotations

import itertools
import json
from base64 import b64encode
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ValidationError

from automcm_conformance.adapter.adapter import Adapter, LineByLine
from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.adapter.protocol import (
    INDICATIONS,
    HelloAnswer,
    Object,
    ProtocolError,
    read_answer,
)
from automcm_conformance.exchange.answers import are_marks, differences
from automcm_conformance.exchange.exchange import Broken, LineLink, Mismatch, Step, Wrong
from automcm_conformance.exchange.results import Verdict
from automcm_conformance.exchange.wire import Required, encode
from automcm_spec.log_format.log import EVENT_KINDS
from automcm_spec.log_format.problems import problems_of
from automcm_spec.log_format.writer import LogWriter
from automcm_spec.support import files
from automcm_spec.support.bad_input import BadInput
from automcm_spec.vocabulary.parameters import LIMITS

FORMAT = "automcm.replay/1"


class _Line(BaseModel, extra="forbid"):
    now: int
    line: Object
    expected: Required


class _Replay(BaseModel, extra="forbid"):
    format: Literal["automcm.replay/1"]
    case: str
    rule: str
    what: str
    steps: list[_Line]


def replay_text(case: str, rule: str, what: str, steps: Sequence[Step]) -> str:
    """An exchange as a replay file: each line with the expected answer."""
    lines = [{"now": s.now, "line": s.command, "expected": asdict(s.expected)} for s in steps]
    about = {"format": FORMAT, "case": case, "rule": rule, "what": what}
    return json.dumps(about | {"steps": lines}, indent=1) + "\n"


def read_replay(path: Path) -> tuple[dict[str, str], list[Step]]:
    """The metadata (``case``, ``rule``, ``what``) and the steps of a replay file.

    Raises BadInput and OSError.
    """
    try:
        replay = _Replay.model_validate_json(path.read_bytes())
    except ValidationError as error:
        raise BadInput(path, 0, *problems_of(error)[0], FORMAT) from None
    about = {"case": replay.case, "rule": replay.rule, "what": replay.what}
    return about, [Step(s.now, encode(s.line), s.expected) for s in replay.steps]


def replayed(steps: Sequence[Step], link: LineLink) -> list[Step]:
    """Send the lines again, one by one. Raises Mismatch at the first wrong answer, and the errors
    of the link and of ``read_answer``."""
    done: list[Step] = []
    for step in steps:
        try:
            (step.answer,) = link.exchange([step.line])
        except AdapterError as error:
            for answer in error.answers:
                step.answer = answer
                differences(step.expected, answer)  # what cannot be read says more
            raise
        problems = differences(step.expected, step.answer)
        done.append(step)
        if problems:
            raise Mismatch(done, problems)
    return done


def failure_of(steps: Sequence[Step], adapter: Adapter) -> Wrong | None:
    """The first failure when the lines are sent again, one by one; None if there is none."""
    try:
        replayed(steps, LineByLine(adapter))
    except Mismatch as wrong:
        return wrong
    except (AdapterError, ProtocolError) as broken:
        answered = sum(1 for step in steps if step.answer)
        unanswered = isinstance(broken, AdapterError) and not broken.answers
        return Broken(list(steps[: answered + unanswered]), broken)
    return None


@dataclass(frozen=True)
class ReplayedFailure:
    """The verdict on one recorded exchange; ``sent`` holds the steps up to its end."""

    case: str
    rule: str
    verdict: Verdict
    what: str
    sent: list[Step]
    stderr: Sequence[str] = ()

    @property
    def exit_code(self) -> int:
        """That of ``conform replay``."""
        return 0 if self.verdict == "PASS" else 1 if self.verdict == "FAIL" else 3

    def as_dict(self) -> dict[str, str]:
        """For ``--json``."""
        return {"case": self.case, "verdict": self.verdict, "what": self.what}


def replay_failure(file: Path, command: Sequence[str], limit_s: float) -> ReplayedFailure:
    """Send the lines of a replay file to the adapter that ``command`` starts.

    Raises BadInput for the file, and the errors of starting the adapter.
    """
    about, steps = read_replay(file)
    station = Adapter(list(command), limit_s)
    try:
        wrong = failure_of(steps, station)
    finally:
        station.stop()
    verdict: Verdict = "PASS" if wrong is None else wrong.verdict
    what = "" if wrong is None else str(wrong)
    sent, stderr = wrong.steps if wrong else steps, getattr(wrong, "stderr", ())
    rule = about["rule"]
    if f": {what};" in f": {about['what']};":
        what = about["what"] if verdict == "FAIL" else what  # with the defect of the message
    elif isinstance(wrong, Mismatch):  # something else than in the file
        rule = sent[-1].expected.rule
    return ReplayedFailure(about["case"], rule, verdict, what, sent, stderr)


def _write_log(path: Path, case: str, steps: Sequence[Step], hello: HelloAnswer) -> None:
    """Write the exchange as a log of the station: its answers, with the timers of the
    specification. Raises ValueError if a log cannot hold it."""
    if any(step.pairs and not step.effects for step in steps):
        raise ValueError("timers were not kept")
    reset = steps[0].command
    known = {n: ms for n, ms in reset["parameters"].items() if n in (*LIMITS, "clock_drift")}
    count = itertools.count(1)
    about = {"run": case, "station": reset["station"]}
    about |= {"implementation": hello.name, "version": hello.version}
    with (
        files.writing(path) as file,
        LogWriter(file, **about, parameters=known, complete=EVENT_KINDS) as log,
    ):
        for step in steps:
            shown = step.pairs or step.command["cmd"] == "advance"
            if not shown and not (step.fault and step is steps[-1]):
                continue
            command, answer = step.command, read_answer(step.answer)
            more = {} if answer.phase is None else {"phase": answer.phase}
            if not shown:
                raw = b64encode(json.dumps(command["message"]).encode()).decode()
                log.event("receive", step.now, raw=raw, **more)
            messages, indications = iter(answer.messages), map(bare, answer.indications)
            cams, marks = answer.cams, step.expected.marks
            before = [c for c in cams if not marks or are_marks(marks[0], c.get("marks"))]
            send = partial(_send, log, reset["station"], count, step.now)
            send(before)
            for effects in step.effects:
                if effects.expired is not None:
                    expired = _timer(effects.expired)
                    log.event("timer", step.now, op="expire", timer=expired, **more)
                else:
                    log.event(command["cmd"], step.now, **given(command), **more)
                send(islice(messages, effects.messages))
                for timer in effects.stopped:
                    log.event("timer", step.now, op="stop", timer=_timer(timer))
                for timer, deadline in effects.armed:
                    armed = _timer(timer)
                    log.event("timer", step.now, op="arm", timer=armed, deadline=deadline)
                for indication in islice(indications, effects.indications):
                    log.event("indication", step.now, indication=indication)
            send(messages)
            for indication in indications:
                log.event("indication", step.now, indication=indication)
            send(c for c in cams if c not in before)


def log_of(folder: Path, case: str, steps: Sequence[Step], hello: HelloAnswer) -> str:
    """Write the log of an exchange into the ``logs`` of a folder. Returns its relative path, or an
    empty text if there is no exchange, or a log cannot hold an answer."""
    if not steps:
        return ""
    path = folder / "logs" / f"{case.replace('/', '-')}.ndjson"
    files.folder(path.parent)
    try:
        _write_log(path, case, steps, hello)
    except ValueError:
        path.unlink(missing_ok=True)
        return ""
    return str(path.relative_to(folder))


def bare(indication: Object) -> Object:
    """An indication with only the fields of the protocol; a log may be unable to hold others."""
    return {name: indication[name] for name in ("name", *INDICATIONS[indication["name"]])}


def given(command: Object) -> Object:
    """What a command gives the station, as the log of its input has it; None for what it lacks."""
    return {name: command.get(name) for name in ("message", "planned", "command")}


def _send(
    log: LogWriter, station: int, count: Iterator[int], now: int, messages: Iterable[Object]
) -> None:
    for message in messages:
        log.event("send", now, tx=f"{station}:{next(count)}", message=message)


def _timer(timer: Object) -> Object:
    """The name of a timer in a log."""
    if "message" not in timer:
        return timer
    m = timer["message"]
    about = {"type": m["type"]} | ({"to": m["dst"]} if "dst" in m else {})
    return {"name": timer["name"], "message": about | {"session": m["session"], "seq": m["seq"]}}
