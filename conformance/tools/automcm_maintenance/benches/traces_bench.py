"""The cost of judging logs, beside reading them."""

from __future__ import annotations

import json

from automcm_maintenance.benches.plugin import Timed
from automcm_maintenance.documents.repository import ROOT
from automcm_spec.log_format.reader import LogStream
from automcm_traces.explain.explain import verdict_of

RUNS = ("four-vehicles", "pair", "secured")
LOGS = [p for name in RUNS for p in sorted((ROOT / "traces" / "corpus" / name).iterdir())]
"""Of the reference: the corpus has them."""
EVENTS = sum(path.read_bytes().count(b"\n") for path in LOGS)


def bench_json_loads(timed: Timed) -> None:
    """Every line; µs an event, as below."""
    lines = [line for path in LOGS for line in path.read_bytes().splitlines()]
    timed(lambda: [json.loads(line) for line in lines], per=EVENTS)


def bench_read(timed: Timed) -> None:
    """With a check of the format."""
    timed(lambda: [list(LogStream(path)) for path in LOGS], per=EVENTS, beside=("json_loads", 5))


def bench_explain(timed: Timed) -> None:
    """Reading and judging."""

    def judge() -> None:
        assert all(verdict_of(path).verdict == "allowed" for path in LOGS)

    timed(judge, per=EVENTS, beside=("read", 6))
