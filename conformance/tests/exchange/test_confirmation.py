"""Wrong answers that a fresh process does not give, and the very line of a crash."""

from __future__ import annotations

from typing import Any

import pytest
from suite_stage import ACCEPTS, BUSY, Suite, of
from suite_stage import conform as conform
from wrong_station import station

from automcm_conformance.adapter.process import AdapterError
from automcm_conformance.exchange.answers import differences
from automcm_conformance.exchange.confirmation import in_fresh_process
from automcm_conformance.exchange.exchange import Mismatch, Step
from automcm_conformance.exchange.results import KEPT, NONDETERMINISTIC
from automcm_conformance.exchange.wire import Required

STATIC = """
joined = set()
def answer(c):
    "The sessions joined are a static variable, which no reset empties."
    if received(c, "Advertisement") and "planned" in c:
        session = tuple(c["message"]["session"])
        if session in joined:
            del c["planned"]
        joined.add(session)
    return right(c)
"""


@pytest.mark.slow
def test_state_that_is_kept_over_reset_is_named(conform: Suite) -> None:
    found = conform(station(STATIC), "AMCM/STA/ADV/BV-02", states=60)
    (case,) = found.cases
    assert case.verdict == "ERROR" and case.reason.startswith(f"{KEPT}: a fresh process")
    assert found.causes[0][0][1].difference == KEPT


class Scripted:
    """An adapter whose processes give the wrong deadline, or the right one, as a list says."""

    def __init__(self, wrong: list[bool], runs: bool) -> None:
        self.wrong, self.runs = wrong, runs
        self.broken = self.hung = 0

    def renew(self) -> None:
        self.runs = False

    def exchange(self, lines: list[bytes], *, continued: bool = False) -> list[bytes]:
        deadline = "7" if self.wrong.pop(0) else "null"
        return [f'{{"messages":[],"indications":[],"deadline":{deadline}}}'.encode()]


@pytest.mark.parametrize(
    ("wrong", "runs", "why"),
    [
        ([True, True], True, ""),
        ([True, False, False, False], True, KEPT),
        ([False, False, False, False], True, NONDETERMINISTIC),
        ([False, False, False], False, KEPT),
    ],
)
def test_state_is_kept_only_if_the_used_process_fails_again(
    wrong: list[bool], runs: bool, why: str
) -> None:
    step = Step(1, b'{"cmd":"reset"}', Required())
    step.answer = b'{"messages":[],"indications":[],"deadline":7}'
    adapter: Any = Scripted(wrong, runs)
    error = Mismatch([step], differences(step.expected, step.answer))
    assert in_fresh_process(adapter, error, repeated=True).unconfirmed == why


def test_a_surplus_line_is_shown_instead_of_what_follows_from_it() -> None:
    class Writes(Scripted):
        def exchange(self, lines: list[bytes], *, continued: bool = False) -> list[bytes]:
            raise AdapterError("output", "too many")

    step = Step(1, b'{"cmd":"reset"}', Required())
    step.answer = b'{"messages":[],"indications":[],"deadline":7}'
    error = Mismatch([step], differences(step.expected, step.answer))
    adapter: Any = Writes([], runs=False)
    assert str(in_fresh_process(adapter, error, repeated=True)) == "too many"


BATCHES = """
import select
def answer(c):
    if c["cmd"] != "hello" and received(c, "Prescription") and foreign(c):
        os._exit(3)
    return right(c)
held, lines = b"", b""
while True:
    if held and not select.select([0], [], [], 0.02)[0]:
        os.write(1, held)
        held = b""
    lines += os.read(0, 1 << 16) or b'{"cmd": "stop"}\\n'
    *whole, lines = lines.split(b"\\n")
    for command in map(json.loads, whole):
        if command["cmd"] == "stop":
            sys.exit()
        held += json.dumps(answer(command)).encode() + b"\\n"
"""
"""It answers when there is nothing left to read."""


@pytest.mark.slow
def test_the_line_of_a_crash_is_shown_though_the_adapter_batches(conform: Suite) -> None:
    found = conform(station(BATCHES), BUSY, ACCEPTS, states=60)
    case = of(found, BUSY)
    assert case.verdict == "ERROR" and "with exit code 3" in case.reason
    last = case.failures[0].exchange[-1]
    assert last.who == "kit" and "receive" in last.text and "Prescription" in last.text
    assert of(found, ACCEPTS).verdict == "PASS"
