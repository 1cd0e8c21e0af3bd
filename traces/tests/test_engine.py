"""The engine: what it loads, what it follows beyond any graph, and what it cannot conclude."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from edits import HEADER

from automcm_spec.vocabulary.messages import Acceptance
from automcm_traces.checker.engine import Engine
from automcm_traces.checker.follow import NEEDED
from automcm_traces.checker.track import INITIAL, CannotTell, Entry
from automcm_traces.format.log import RECORD
from automcm_traces.format.reader import Log, read

CORPUS = Path(__file__).resolve().parents[1] / "corpus"


def a_log() -> Log:
    """A complete log in which something is sent."""
    return read(CORPUS / "pair" / "1001.ndjson")


@pytest.mark.parametrize(
    ("name", "verdict"),
    [("pair/1001.ndjson", "allowed"), ("bad/accepts_unasked.ndjson", "diverges")],
)
def test_no_log_loads_a_graph(name: str, verdict: str) -> None:
    """The first answer comes in 0.3 s of CPU, with 40 MB; a graph takes 200."""
    code = (
        "import sys\n"
        "from automcm_traces.explain.explain import explain_file\n"
        "print(explain_file(sys.argv[1]).verdict)\n"
        "print('automcm_spec.graph.oracle' in sys.modules)\n"
        "print(next(line for line in open('/proc/self/status') if 'VmHWM' in line))\n"
    )
    command = [sys.executable, "-c", code, str(CORPUS / name)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    said, graphs, most = done.stdout.strip().splitlines()
    assert (said, graphs) == (verdict, "False")
    assert int(most.split()[1]) < 80 * 1024  # KiB


def test_neg_1_more_proposals_at_once_than_any_graph_knows() -> None:
    """A receiver whose answers to 3, 4 and 5 are still being sent gets proposal 6."""
    about = {"src": 2002, "dst": 1001, "session": (1001, 7), "seq": 1, "proposal": 1}
    refusal = Acceptance(**about, accepted=False, reason="unsafe")
    answers = [
        Entry(
            "Acceptance", 1001, (1001, 7), k, refusal.model_copy(update={"seq": k, "proposal": k})
        )
        for k in (3, 4, 5)
    ]
    state = INITIAL._replace(phase="WAITING", role="receiver", session=(1001, 7), proposal=5)
    state = state._replace(joined=frozenset({(1001, 7)}), outbox=frozenset(e.spec for e in answers))
    header = {**HEADER, "station": 2002, "complete": list(NEEDED), "parameters": {"max_rounds": 9}}
    m = {"v": 1, "type": "Prescription", "src": 1001, "dst": 2002, "session": [1001, 7], "seq": 9}
    m |= {"proposal": 6, "prescribed": {"t0": 0, "points": [[0, 0, 0]]}}
    m |= {"hold_ms": 1, "lease_ms": 700}
    received = {"rec": "event", "seq": 1, "t_ms": 5, "ev": "receive", "tx": "1001:1", "message": m}
    event = RECORD.validate_python(received)
    engine = Engine(RECORD.validate_python(header))
    engine.track.state, engine.track.outbox = state, answers
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
