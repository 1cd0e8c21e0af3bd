"""Run on a copy of spec/ whose Station.tla is edited: regenerate, explain logs, play a scenario.

Arguments: a scenario, the folder with logs of it, an empty folder.  Prints JSON.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from automcm_maintenance.compilation import compiler


def found(scenario: str, logs: Path, empty: Path) -> dict[str, Any]:
    """The verdict on each log, and on the reference; and the rules and phases met in the logs."""
    sys.path.append(str(Path(__file__).with_name("scenarios")))
    from test_scenarios import REFERENCE, run  # after the station is compiled

    from automcm_conformance.exchange.transcript import finding
    from automcm_traces.explain.coverage import measure
    from automcm_traces.explain.explain import verdict_of

    files = sorted(logs.rglob("*.ndjson"))
    covered = measure(files)
    outcome = run(scenario, REFERENCE, empty)
    verdicts = [verdict_of(file) for file in files]
    return {
        "verdicts": [
            {"verdict": v.verdict, "rule": v.finding.rule, "event": v.finding.observed}
            for v in verdicts
        ],
        "played": [outcome.verdict, finding(outcome.finding)],
        "met": sorted({*covered.counts["rules"], *covered.counts["phases"]}),
    }


if __name__ == "__main__":
    compiler.PATH.write_text(compiler.text(), encoding="utf-8")
    print(json.dumps(found(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))))
