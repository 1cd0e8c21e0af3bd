"""Both engines on generated logs, good ones and edited ones.

The same seed gives the same logs.  ``python agreement.py 2000`` has both judge so many of each.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from generated_logs import Lines, good_logs, mutated
from tlc_engine import explain_batch

from automcm_spec.log_format.reader import Log, read
from automcm_spec.support.bad_input import BadInput
from automcm_traces.explain.explain import explain


def written(lines: Lines, path: Path) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def judgeable(path: Path) -> list[Log]:
    """The log; none if it cannot be read: both engines have the same reader."""
    try:
        return [read(path)]
    except BadInput:
        return []


def different(logs: Sequence[Log]) -> list[str]:
    """What the engines say of the logs of which they do not say the same."""
    found = []
    for one, two in zip(map(explain, logs), explain_batch(logs), strict=True):
        mine, theirs = ((v.verdict, v.finding.at.line, v.finding.rule) for v in (one, two))
        if mine != theirs:
            found.append(f"{one.file}: {mine}: {one.finding.observed}; TLC: {theirs}")
    return found


def main(number: int) -> int:
    """Have both engines judge; returns how many good logs diverge, or verdicts are not the same."""
    with tempfile.TemporaryDirectory() as folder:
        good, edited = [], []
        kinds: Counter[str] = Counter()
        for n, lines in enumerate(good_logs(number, 1)):
            good += [read(written(lines, Path(folder) / f"{n}-good"))]
            changed, kind, line = mutated(lines, n)
            log = judgeable(written(changed, Path(folder) / f"{n}-{kind}-{line}"))
            kinds[kind, bool(log)] += 1
            edited += log
        problems = [f"{log.file}: not allowed" for log in good if explain(log).verdict != "allowed"]
        problems += different([*good, *edited])
    print(*problems, sep="\n")
    print(f"{len(good)} good logs, {len(edited)} edited ones, {len(problems)} problems; {kinds}")
    return len(problems)


if __name__ == "__main__":
    raise SystemExit(main(int(sys.argv[1])) > 0)
