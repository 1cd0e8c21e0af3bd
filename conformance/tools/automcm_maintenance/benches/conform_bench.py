"""The cost of checking an adapter, beside the same lines with no answer checked."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

import pytest

from automcm_cli.shared.adapter_options import purposes_of
from automcm_conformance.adapter.adapter import Adapter
from automcm_conformance.adapter.process import Process
from automcm_conformance.suite.graph_cases import Runner
from automcm_conformance.suite.purposes import Owners
from automcm_conformance.suite.tally import PairPart
from automcm_maintenance.benches.plugin import Timed
from automcm_maintenance.code_mutation.cpp_station import build, missing
from automcm_spec.graph.oracle import load
from automcm_spec.graph.oracle_generation import ONE_PEER, spec_hash
from automcm_spec.support.collection import uncollected

LIMIT_S = 60.0
CASES = ["AMCM/RCV/NEG", "AMCM/PRE/END"]
PYTHON = [sys.executable, "-m", "automcm_cli", "adapter"]
pytestmark = pytest.mark.benchmark(timer=time.perf_counter)


@pytest.fixture(scope="module", params=["python", "cpp"])
def station(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The command of a station in this language."""
    if request.param == "python":
        return PYTHON
    if lacks := missing():
        pytest.skip(f"needs {lacks}")
    return [str(build(tmp_path_factory.mktemp("cpp")))]


class SentLines(Adapter):
    """Records the lines that it writes."""

    def __init__(self, command: Sequence[str]) -> None:
        super().__init__(command, LIMIT_S)
        self.bulks: list[list[bytes]] = []

    def send(self, lines: Sequence[bytes], *, continued: bool = False) -> None:
        """As ``Adapter.send``."""
        self.bulks.append(list(lines))
        super().send(lines, continued=continued)


def planned(command: Sequence[str]) -> tuple[SentLines, Callable[[], None]]:
    """CASES, planned on a station that has started: its adapter, and what drives them."""
    oracle, purposes = load(ONE_PEER.path, spec_hash()), purposes_of(CASES)
    adapter = SentLines(command)
    runner = Runner(adapter, purposes, 1, lambda text: None)
    everything = (a for state in range(len(oracle.states)) for a in oracle.answers(state))
    part = PairPart("bench", oracle)
    runner.plan(part, everything, Owners(purposes))

    def drive() -> None:
        with uncollected():
            runner.tour(part)
        assert not any(tally.faults for tally in runner.tallies.values())

    return adapter, drive


@pytest.fixture(scope="module")
def bulks() -> list[list[bytes]]:
    """The lines of CASES."""
    adapter, drive = planned(PYTHON)
    drive()
    adapter.stop()
    return adapter.bulks


def bench_unchecked(station: list[str], bulks: list[list[bytes]], timed: Timed) -> None:
    """µs a line, as below, from a started station whose answers nobody checks."""
    with Process(station, limit_s=LIMIT_S) as process:
        process.exchange([b'{"cmd":"hello","protocol":1}\n'])
        timed(lambda: [process.exchange(b) for b in bulks], sum(map(len, bulks)), rounds=1)


def bench_checked(station: list[str], bulks: list[list[bytes]], timed: Timed) -> None:
    """With every answer checked. C++ answers sooner, so its bar is higher."""
    adapter, drive = planned(station)
    bar = "unchecked", 2 if station == PYTHON else 6
    timed(drive, sum(map(len, bulks)), rounds=1, beside=bar)
    adapter.stop()
