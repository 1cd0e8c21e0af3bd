"""The kit has two judges: the exchange predicts answers, the log engine follows events.  What one
of them says of an exchange the other says of its log."""

from __future__ import annotations

from pathlib import Path

import pytest
from suite_stage import IGNORES, Suite
from suite_stage import conform as conform
from wrong_station import station

from automcm_spec.log_format.reader import read
from automcm_traces.checker.finding import Finding
from automcm_traces.checker.follow import Check

CASES = ("AMCM/RCV", "AMCM/PRE/NEG")
SAYS = """
def bad(c, out):
    return out | {{'messages': [m | {change} for m in out['messages']]}}
def answer(command):
    out = right(command)
    sent = [m['type'] for m in out.get('messages', ())]
    return bad(command, out) if sent[:1] == [{type!r}] else out
"""


def judged(folder: Path, log: str) -> Finding:
    return Check(read(folder / "report" / log)).read().finding


@pytest.mark.slow
def test_of_what_the_exchange_accepts_the_engine_says_nothing(conform: Suite) -> None:
    found = conform(station(), *CASES, states=60)
    logs = [case.log for case in found.cases if case.log and case.verdict == "PASS"]
    assert len(logs) > 10
    for log in logs:
        assert judged(conform.folder, log).kind == "nothing", log


@pytest.mark.slow
@pytest.mark.parametrize(
    "code",
    [
        IGNORES,
        SAYS.format(type="Acceptance", change="{'proposal': m['proposal'] + 1}"),
        SAYS.format(type="Cancel", change="{'reason': 'other'}"),
        SAYS.format(type="Ack", change="{'of': m['of'] | {'seq': m['of']['seq'] + 1}}"),
        SAYS.format(type="Intention", change="{'seq': m['seq'] + 1}"),
    ],
    ids=["missing", "proposal", "reason", "of", "seq"],
)
def test_what_the_exchange_refuses_diverges_by_the_same_rule(conform: Suite, code: str) -> None:
    found = conform(station(code), *CASES, states=60)
    failed = [case for case in found.cases if case.verdict == "FAIL" and case.log]
    assert failed
    for case in failed:
        finding = judged(conform.folder, case.log)
        assert finding.kind in ("missing", "unexpected"), (case.id, finding)
        (first, *_) = case.failures
        wrong_of = first.difference.startswith("Ack.of") and first.rule == "END-6"
        assert wrong_of or finding.rule == first.rule, (case.id, finding, first.what)
