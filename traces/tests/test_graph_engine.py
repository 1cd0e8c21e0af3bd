"""The engine on the compiled specification against the one on the finite graph."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from agreement import mutated, of_the_reference

from automcm_traces.engine import Engine
from automcm_traces.explain import NEEDED
from automcm_traces.graph_engine import GraphEngine
from automcm_traces.log import RECORD
from automcm_traces.reader import Log, LogError, read
from automcm_traces.step import Diverges, Step
from automcm_traces.track import INITIAL, CannotTell, Entry, Track

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


def a_log() -> Log:
    """A complete log in which something is sent."""
    log = complete(CORPUS / "pair" / "1001.ndjson")
    assert log is not None
    return log


def test_an_allowed_complete_log_loads_no_graph() -> None:
    """Nor what asks one: the first answer comes in 0.2 s of CPU, with 40 MB."""
    code = (
        "import sys\n"
        "from automcm_traces.explain import explain_file\n"
        "print(explain_file(sys.argv[1]).verdict)\n"
        "print(*(m for m in sys.modules if m.startswith('automcm_')))\n"
        "print(next(line for line in open('/proc/self/status') if 'VmHWM' in line))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, a_log().file], capture_output=True, text=True, check=True
    )
    verdict, modules, most = done.stdout.strip().splitlines()
    graph = {"asking", "graph_engine", "graph_inputs", "graph_view", "possible"}
    assert verdict == "allowed"
    assert graph & {name.split(".")[-1] for name in modules.split()} == set()
    assert int(most.split()[1]) < 80 * 1024  # KiB


def test_neg_1_more_proposals_at_once_than_the_graph_knows() -> None:
    """A receiver whose answers to 3, 4 and 5 are still being sent gets proposal 6."""
    answers = [
        Entry("Acceptance", 1001, (1001, 7), k, {"seq": k, "proposal": k, "accepted": False})
        for k in (3, 4, 5)
    ]
    state = INITIAL._replace(phase="WAITING", role="receiver", session=(1001, 7), proposal=5)
    state = state._replace(joined=frozenset({(1001, 7)}), outbox=frozenset(e.spec for e in answers))
    header = {"rec": "header", "schema": "automcm.trace/1", "run": "r", "station": 2002}
    header |= {"implementation": {"name": "i", "version": "1"}, "complete": list(NEEDED)}
    header |= {"parameters": {"max_rounds": 9}}
    m = {"v": 1, "type": "Prescription", "src": 1001, "dst": 2002, "session": [1001, 7], "seq": 9}
    m |= {"proposal": 6, "prescribed": {"t0": 0, "points": [[0, 0, 0]]}}
    m |= {"hold_ms": 1, "lease_ms": 700}
    received = {"rec": "event", "seq": 1, "t_ms": 5, "ev": "receive", "tx": "1001:1", "message": m}
    event = RECORD.validate_python(received)
    for make in (Engine, GraphEngine):
        engine = make(RECORD.validate_python(header))
        engine.track.state, engine.track.outbox = state, answers
        if make is GraphEngine:
            with pytest.raises(CannotTell, match="not in the oracle"):
                engine.feed(2, event)
            continue
        engine.feed(2, event)
        assert engine.step is not None
        assert (engine.step.rule, engine.step.after.proposal) == ("NEG-1", 6)
        assert [str(message) for message in engine.step.messages] == [
            "Ack to 1001 session=1001/7 (of Prescription seq=9)"
        ]


def test_where_a_message_may_be_missing_nothing_is_concluded_from_it() -> None:
    log = a_log()
    header = log.header.model_copy(update={"complete": ("command", "receive")})
    engine = Engine(header)
    with pytest.raises(CannotTell, match="line 2: the log does not hold: send Advertisement"):
        for at, event in log.events:
            if event.ev in header.complete:
                engine.feed(at, event)
