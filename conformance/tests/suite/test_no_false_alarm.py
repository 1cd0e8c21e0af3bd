"""Stations that answer otherwise than the reference, but rightly: the suite passes them all."""

from __future__ import annotations

import pytest
from suite_stage import ACCEPTS, BUSY, Suite
from suite_stage import conform as conform
from wrong_station import station

VARIANTS = {
    "the messages of an answer in reversed order": """
def vary(c, out):
    return out | {"messages": out["messages"][::-1]}
""",
    "more fields in indications": """
def vary(c, out):
    more = {"seq": 1, "text": "\\u00e4", "detail": None, "list": [[]]}
    return out | {"indications": [more | told for told in out["indications"]]}
""",
    "Cancels in another order, with other seq": """
from automcm.core import ending, outcome, prescribing
cancels = outcome.cancels
def backwards(me, st, to, reason, first=1):
    return cancels(me, st, [*to][::-1], reason, first)
for module in (ending, outcome, prescribing):
    module.cancels = backwards
""",
    "zero as -0": """
def vary(c, out):
    return json.dumps(out).replace(": 0,", ": -0,").replace("[0, 0,", "[-0, -0,").encode() + b"\\n"
""",
    "session numbers from a clock": """
UNIX_US = 1_700_000_000_000_000
def before(c):
    if c["cmd"] == "command" and c["command"]["name"] == "request" and not state().bound:
        number = max(state().number, UNIX_US + min(c["now"] * 1000, 2**52))
        station._station.state = state()._replace(number=number)
""",
}
ALL = """
vary = lambda c, out: out
before = lambda c: None
{variant}
def answer(c):
    if station._station:
        before(c)
    out = right(c)
    return vary(c, out) if "deadline" in out else out
"""
CASES = (BUSY, ACCEPTS, "PRE-2", "AMCM/STA/ADV/BV-01", "AMCM/PRE/PRE/TI", "AMCM/STA/END/BV-04")
"""Among them a scenario with three receivers, to two of which a Cancel is sent."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "how", [pytest.param(h, marks=[pytest.mark.slow] * (n != 4)) for n, h in enumerate(VARIANTS)]
)
def test_what_the_specification_leaves_open_is_no_failure(conform: Suite, how: str) -> None:
    found = conform(station(ALL.format(variant=VARIANTS[how])), *CASES, states=60)
    wrong = [(case.id, case.reason) for case in found.cases if case.verdict not in ("PASS", "SKIP")]
    assert not wrong and found.counts["PASS"] > 5 and not found.problems
