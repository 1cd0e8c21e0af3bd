"""The suite in a folder of its own, on graphs that are cut down: a few seconds a run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from automcm_conformance.adapter import adapter
from automcm_conformance.adapter.process import Process
from automcm_conformance.exchange.results import CaseResult, Report
from automcm_conformance.exchange.wire import PLAIN
from automcm_conformance.scenarios import scenario_cases
from automcm_conformance.suite import graph_cases, purposes, suite_run, two_peer_pairs, verdicts
from automcm_conformance.suite.tally import PairPart
from automcm_spec.graph.oracle import Oracle, content
from automcm_spec.graph.oracle_generation import ONE_PEER, TIGHT

Json = Any
LIMIT = 60.0
SHORT = 1.0
"""A time limit that the test waits for."""
STATES = 200
"""Of a graph that is cut down: the first of them, in which every phase occurs."""

# -- graphs that are loaded once, and cut down


@cache
def data(path: Path) -> dict[str, Json]:
    value: dict[str, Json] = json.loads(content(path))
    return value


@cache
def graph(path: Path) -> Oracle:
    return Oracle(data(path))


@cache
def first_of(path: Path, n: int) -> Oracle:
    """The part of a graph with its first ``n`` states, which are those nearest to the initial
    one, and all that time leads to from there."""
    whole_ = data(path)
    expiries = {i for i, value in enumerate(whole_["inputs"]) if value[0] == "expire"}
    rows = [[row[k : k + 3] for k in range(0, len(row), 3)] for row in whole_["transitions"]]
    kept = set(range(n))
    left = list(kept)
    while left:
        after = {move[1] for move in rows[left.pop()] if move[0] in expiries} - kept
        kept |= after
        left += after
    place = {state: k for k, state in enumerate(sorted(kept))}
    out = dict(whole_)
    for name in ("states", "marks", "answers", "parents"):
        out[name] = [whole_[name][state] for state in place]
    out["transitions"] = [
        [x for i, to, effect in rows[state] if to in place for x in (i, place[to], effect)]
        for state in place
    ]
    return Oracle(out)


class Patient(Process):
    """A Python station takes its time to start."""

    def exchange(self, lines: Any) -> list[bytes]:
        limit, self.limit_s = self.limit_s, LIMIT
        if b'"hello"' not in lines[0]:
            self.limit_s = limit
        try:
            return super().exchange(lines)
        finally:
            self.limit_s = limit


@dataclass
class Suite:
    """Runs the suite into a folder of its own."""

    folder: Path
    patch: pytest.MonkeyPatch

    def __call__(
        self,
        command: list[str],
        *selectors: str,
        states: int = STATES,
        limit_s: float = LIMIT,
        seed: int = 1,
        expected: verdicts.Expectations | None = None,
        folder: str = "report",
        stop_after: int = 0,
        quick: bool = False,
    ) -> Report:
        one = graph(ONE_PEER.path)
        cut = {
            ONE_PEER.path: first_of(ONE_PEER.path, states),
            TIGHT.path: graph(TIGHT.path),
        }
        self.patch.setattr(suite_run, "load", lambda path, spec: cut[path])
        self.patch.setattr(suite_run, "two_peers", lambda spec: graph(TIGHT.path))
        self.patch.setattr(
            suite_run,
            "PairPart",
            lambda name, o, third=False: PairPart(name, one if name == "special" else o, third),
        )
        self.patch.setattr(graph_cases, "VALUES", (PLAIN,))  # stations here may know an id
        self.patch.setattr(two_peer_pairs, "read", lambda two: [])
        for module in (adapter, scenario_cases):
            self.patch.setattr(module, "Process", Patient)
        chosen = purposes.select(purposes.load(), selectors)
        return suite_run.conform(
            command,
            chosen,
            self.folder / folder,
            limit_s=limit_s,
            seed=seed,
            notify=lambda text: None,
            selectors=selectors,
            expected=expected or {},
            stop_after=stop_after,
            quick=quick,
        )


@pytest.fixture
def conform(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Suite:
    return Suite(tmp_path, monkeypatch)


def of(found: Report, name: str) -> CaseResult:
    (case,) = [case for case in found.cases if case.id == name]
    return case


BUSY = "AMCM/RCV/NEG/BI-04"
ACCEPTS = "AMCM/RCV/NEG/BV-03"
LATER = "AMCM/PRE/ADV/TI-02"
"""A case that no graph carries, so it comes last."""


FOREIGN = """
def answer(command):
    out = right(command)
    if station._station and foreign(command):
        out = bad(command, out)
    return out
"""


IGNORES = "def bad(c, out): return out | {'messages': []}" + FOREIGN
"""A busy station that does not refuse."""
