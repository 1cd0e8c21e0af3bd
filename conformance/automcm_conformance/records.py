"""What a run leaves behind: logs in the trace format, and files that replay an exchange."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from pydantic_core import from_json

from automcm_conformance.answers import differences
from automcm_conformance.exchange import Link, Mismatch, Step
from automcm_conformance.process import AdapterError
from automcm_conformance.protocol import INDICATIONS
from automcm_conformance.wire import Expected
from automcm_spec import files
from automcm_traces.writer import LogWriter

Json = Any
FORMAT = "automcm.replay/1"
LIMITS = ("max_rounds", "max_participants", "outbox_limit", "memory_limit")
COMPLETE = ("command", "indication", "receive", "restart", "send", "timer")


class ReplayError(ValueError):
    """A file that is no replay; the text names the file and the field."""


def replay_text(case: str, rule: str, what: str, steps: Sequence[Step]) -> str:
    """An exchange, line by line, with what is expected."""
    return (
        json.dumps(
            {
                "format": FORMAT,
                "case": case,
                "rule": rule,
                "what": what,
                "steps": [
                    {"now": s.now, "line": from_json(s.line), "expected": asdict(s.expected)}
                    for s in steps
                ],
            },
            indent=1,
        )
        + "\n"
    )


def read_replay(path: Path) -> tuple[dict[str, str], list[Step]]:
    """What a replay file is about (``case``, ``rule``, ``what``) and its steps.

    Raises ReplayError and OSError.
    """
    try:
        value = json.loads(path.read_bytes())
        if value["format"] != FORMAT:
            raise ReplayError(f"{path}: format: {FORMAT} is needed")
        about = {name: str(value[name]) for name in ("case", "rule", "what")}
        steps = [
            Step(
                int(s["now"]),
                json.dumps(s["line"], separators=(",", ":")).encode() + b"\n",
                Expected(**s["expected"]),
            )
            for s in value["steps"]
        ]
    except KeyError as error:
        raise ReplayError(f"{path}: {error.args[0]}: missing") from None
    except (TypeError, ValueError) as error:
        if isinstance(error, ReplayError):
            raise
        raise ReplayError(f"{path}: no replay: {error}") from None
    return about, steps


def replayed(steps: Sequence[Step], link: Link) -> list[Step]:
    """Send the lines again, one by one.  Raises Mismatch at the first answer that is wrong, and
    what the link and the reading of an answer raise."""
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


def write_log(
    path: Path,
    case: str,
    steps: Sequence[Step],
    name: str,
    version: str,
) -> None:
    """The exchange as a log of the station: what it answered, and the timers as the
    specification has them.  Raises ValueError if it cannot be told in a log."""
    if any(step.pairs and not step.deeds for step in steps):
        raise ValueError("timers were not kept")
    reset = from_json(steps[0].line)
    known = {n: ms for n, ms in reset["parameters"].items() if n in (*LIMITS, "clock_drift")}
    count = itertools.count(1)
    about = {"run": case, "station": reset["station"], "implementation": name, "version": version}
    with (
        files.writing(path) as file,
        LogWriter(file, **about, parameters=known, complete=COMPLETE) as log,
    ):
        for step in steps:
            if not step.pairs and b'"advance"' not in step.line:
                continue
            command, answer = from_json(step.line), from_json(step.answer)
            more = {"phase": answer["phase"]} if "phase" in answer else {}
            messages, told = iter(answer["messages"]), map(bare, answer["indications"])
            cams = answer.get("cams", [])
            marks = step.expected.marks[:1]
            before = [c for c in cams if not marks or sorted(c["marks"]) in marks]
            send = partial(_send, log, reset["station"], count, step.now)
            send(before)
            for deed in step.deeds:
                if deed.expired is not None:
                    expired = _timer(deed.expired)
                    log.event("timer", step.now, op="expire", timer=expired, **more)
                else:
                    _input(log, step.now, command, more)
                send(islice(messages, deed.messages))
                for timer in deed.stopped:
                    log.event("timer", step.now, op="stop", timer=_timer(timer))
                for timer, deadline in deed.armed:
                    armed = _timer(timer)
                    log.event("timer", step.now, op="arm", timer=armed, deadline=deadline)
                for indication in islice(told, deed.told):
                    log.event("indication", step.now, indication=indication)
            send(messages)
            for indication in told:
                log.event("indication", step.now, indication=indication)
            send(c for c in cams if c not in before)


def bare(told: Json) -> Json:
    """An indication without what may stand there besides; a log need not be able to hold that."""
    return {name: told[name] for name in ("name", *INDICATIONS[told["name"]])}


def _send(
    log: LogWriter, station: int, count: Iterator[int], now: int, messages: Iterable[Json]
) -> None:
    for message in messages:
        log.event("send", now, tx=f"{station}:{next(count)}", message=message)


def _input(log: LogWriter, now: int, command: Json, more: dict[str, Json]) -> None:
    match command["cmd"]:
        case "receive":
            planned = command.get("planned")
            log.event("receive", now, message=command["message"], planned=planned, **more)
        case "command":
            log.event("command", now, command=command["command"], **more)
        case "restart":
            log.event("restart", now, **more)


def _timer(timer: Json) -> Json:
    """A timer as a log names it."""
    if "message" not in timer:
        return timer
    m = timer["message"]
    about = {"type": m["type"]} | ({"to": m["dst"]} if "dst" in m else {})
    return {"name": timer["name"], "message": about | {"session": m["session"], "seq": m["seq"]}}
