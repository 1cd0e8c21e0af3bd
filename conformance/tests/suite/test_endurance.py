"""What no answer shows is noted: memory that grows, and the end of a process by deep nesting."""

from __future__ import annotations

import sys

import pytest
from forked_station import popen
from suite_stage import Suite, of
from suite_stage import conform as conform
from wrong_station import station

from automcm_conformance.suite import endurance
from automcm_spec.support import children

REFERENCE = [sys.executable, "-m", "automcm.adapters.adapter_lines"]
RECEPTIONS, MALFORMED = "AMCM/RCV/ACT/BV-04", "AMCM/STA/END/BI-19"
KEEPS = "kept = []\ndef answer(c): return kept.append(json.dumps(c)) or right(c)"


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stations of their own: a fork first fills what this process has freed."""
    monkeypatch.setattr(children, "popen", popen)


@pytest.mark.slow
@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(("code", "warm", "noted"), [(KEEPS, 0, 1), ("", 0, 0), (KEEPS, 10**6, 0)])
def test_memory_that_grows_is_noted(
    conform: Suite, monkeypatch: pytest.MonkeyPatch, code: str, warm: int, noted: int
) -> None:
    monkeypatch.setattr(endurance, "WARM", warm)
    found = conform(station(code), RECEPTIONS)
    assert of(found, RECEPTIONS).verdict == "PASS" and found.exit_code == 0
    assert [note.split(",")[0] for note in found.notes] == noted * [
        "the memory of the adapter grows steadily"
    ]


@pytest.mark.parametrize(("command", "noted"), [(REFERENCE, []), (station(), ["exit code 1"])])
def test_a_process_that_ends_at_deep_nesting_is_noted(
    conform: Suite, command: list[str], noted: list[str]
) -> None:
    found = conform(command, MALFORMED)
    assert of(found, MALFORMED).verdict == "PASS" and found.exit_code == 0
    assert [note.rpartition(", with ")[2] for note in found.notes] == noted
