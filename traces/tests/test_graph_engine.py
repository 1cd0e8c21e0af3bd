"""The engine on the compiled specification against the one on the finite graph."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from agreement import mutated, of_the_reference

from automcm_traces.engine import Engine
from automcm_traces.explain import NEEDED
from automcm_traces.graph_engine import GraphEngine
from automcm_traces.reader import Log, LogError, read
from automcm_traces.step import Diverges, Step
from automcm_traces.track import CannotTell, Track

CORPUS = Path(__file__).resolve().parents[1] / "corpus"
MALFORMED = (KeyError, TypeError, IndexError, ValueError, AttributeError)
"""What a message raises that lacks or misuses a field."""


def followed(make: Callable[[Log], Engine], log: Log) -> list[Any]:
    """What an engine says of a log: each step with the station after it, then the verdict.

    Of a message that is not as expected the event says in what; of several that it might have been
    another may be named, so that only the event counts then, and of what is missing the order does
    not count.
    """
    said: list[Any] = []

    def after(step: Step, t: Track) -> None:
        timers = sorted(engine.timers.items())
        said.append((step.at, step.rule, step.what, t.state, t.outbox, t.heard_ms, t.seq, timers))

    engine = make(log)
    engine.observer = after
    try:
        for at, event in log.events:
            engine.feed(at, event)
        if log.ended:
            engine.finish()
    except Diverges as d:
        said.append((d.at, d.event.split(" (")[0], d.rule, d.guard, sorted(d.wanted), d.seen))
    except CannotTell as error:
        said.append(str(error))
    except MALFORMED as error:
        said.append(type(error))
    return said


def complete(path: Path) -> Log | None:
    """The log in a file, if it can be read and promises all that is needed."""
    try:
        log = read(path)
    except LogError:
        return None
    return log if set(NEEDED) <= set(log.header.complete) else None


def differences(logs: list[Log]) -> list[str]:
    """The first difference between the engines on each log that has one."""
    found = []
    for log in logs:
        one, other = followed(Engine, log), followed(GraphEngine, log)
        if one != other:
            pairs = zip(one, other, strict=False)
            first = next(((a, b) for a, b in pairs if a != b), (len(one), len(other)))
            found.append(f"{log.file}: {first[0]} and {first[1]}")
    return found


def test_both_say_the_same_of_every_complete_log_of_the_corpus() -> None:
    logs = [log for path in sorted(CORPUS.rglob("*.ndjson")) if (log := complete(path))]
    assert len(logs) > 780
    assert differences(logs) == []


def test_both_say_the_same_of_edited_logs(tmp_path: Path) -> None:
    logs = []
    path = tmp_path / "log.ndjson"
    for n, lines in enumerate(of_the_reference(75, 5) * 4):
        edited, kind, line = mutated(lines, n)
        path.write_text("\n".join(edited) + "\n")
        if log := complete(path):
            logs.append(replace(log, file=f"{n}: {kind} at {line}"))
    assert len(logs) > 250
    assert differences(logs) == []
