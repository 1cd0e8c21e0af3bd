"""docs/corpus.md: the contents of the corpus, from its index."""

from __future__ import annotations

import json
from pathlib import Path

from automcm_maintenance.corpus.corpus import COVERAGE, WALKED, CorpusEntry, index
from automcm_spec.model_checking import models

VERDICTS = {
    "allowed": "allowed",
    "diverges": "diverges",
    "unreadable": "unreadable",
    "cannot_tell": "cannot tell",
}
HEAD = """# The corpus

`traces/corpus/` holds {logs} logs in the format `automcm.trace/1`, each with its right verdict,
line and rule. `index.json` lists one object for each log: `file`, `story`, `verdict`, `line`
(0: none), `rule` (absent: no rule required the event), `beside` (the log it must be judged with)
and `source`.

    automcm trace explain traces/corpus/bad/busy_accepted.ndjson

Authors of other engines for this format can test them against the index.

`automcm trace itf` converts a counterexample in ITF (`traces/counterexamples/`,
`automcm spec check`) to the logs of its stations, with TLC. It also converts a log to ITF: each
state is the station after a step, and its `#meta` has the operator (`action`), the event's
arguments (`args`), the rule, the line of the log and the place in Station.tla.

    automcm trace itf traces/counterexamples/no_busy_refusal.itf.json --out runs
    automcm trace itf traces/corpus/pair/2002.ndjson --out runs

## Behaviours

These logs contain every transition of the stations in the closed models at least once. A transition
is a state of a station with an input that the model offers there, even if it changes nothing, such
as a duplicate. Transitions are counted from the station's view: the station is 1, the others are
2, 3, … in the order in which state and input name them. TLC prints the graph of the model. A walk
goes from the initial state to the nearest missing transition, and on from there. TLC evaluates
`Step` (Station.tla) for the messages, timers and indications of each step; only ids, content, seqs
and times are invented. So each of these logs is allowed.

Some models are reduced (System.tla); the logs contain the give-ups and answers that they skip. A
model is walked only for transitions that no model above it with as many rounds has. `one_by_three`
is omitted because its receivers have no ids.

| model | states | transitions | not shown above | walks | logs | lines |
|---|---:|---:|---:|---:|---:|---:|
"""
COUNTEREXAMPLES = """
## Counterexamples

The counterexamples of the must-fail models (`docs/models.md`), as logs of their stations; an
inactive station has no log. If the model removes a mechanism of the station, the log of a station
without it diverges. If it changes a bound, an order of timers or the radio, each log alone is
allowed, and the logs together violate a property. The engine computed the verdicts. To view one:
`automcm trace html traces/counterexamples/retarget.itf.json --out retarget.html`.

| log | breaks | verdict | line | rule |
|---|---|---|---:|---|
"""
BAD = """
## Logs with one fault

Each is a good log with one small edit. The expected line follows from the edit: the edited line, or
the input of the step that lacks an event.

| log | story | verdict | line | rule |
|---|---|---|---:|---|
"""
RUNS = """
## Runs of the reference

| log | story |
|---|---|
"""


def page(corpus: Path) -> str:
    """The page of the corpus on disk."""
    entries = index(corpus)
    by_kind: dict[str, list[CorpusEntry]] = {}
    for entry in entries:
        by_kind.setdefault(entry.file.split("/")[0], []).append(entry)
    out = [HEAD.format(logs=f"{len(entries):,}"), *_walked(corpus, by_kind.get("behaviours", []))]
    out.append(COUNTEREXAMPLES)
    breaks = {m.cfg: m.property for m in models.load()}
    for e in by_kind.get("counterexamples", []):
        model = e.file.split("/")[1]
        out.append(f"| `{_short(e)}` | {breaks[model]} | {_verdict_cells(e)} |\n")
    out.append(BAD)
    for e in by_kind.get("bad", []):
        with_ = f" (judged with `{e.beside}`)" if e.beside else ""
        out.append(f"| `{_short(e)}` | {e.story}{with_} | {_verdict_cells(e)} |\n")
    out.append(RUNS)
    for kind in ("four-vehicles", "pair", "secured"):
        for e in by_kind.get(kind, []):
            out.append(f"| `{e.file}` | {e.story} |\n")
    return "".join(out)


def _walked(corpus: Path, entries: list[CorpusEntry]) -> list[str]:
    counts = json.loads((corpus / COVERAGE).read_text())
    rows = []
    total = [0, 0, 0, 0]
    for model in WALKED:
        files = [corpus / e.file for e in entries if e.file.split("/")[1] == model]
        lines = sum(path.read_bytes().count(b"\n") for path in files)
        c = counts[model]
        numbers = [c["new"], c["walks"], len(files), lines]
        total = [a + b for a, b in zip(total, numbers, strict=True)]
        cells = [c["states"], c["transitions"], *numbers]
        rows.append(f"| `{model}` | {' | '.join(f'{n:,}' for n in cells)} |\n")
    rows.append(f"| all | | | {' | '.join(f'{n:,}' for n in total)} |\n")
    return rows


def _short(entry: CorpusEntry) -> str:
    return entry.file.split("/", 1)[1]


def _verdict_cells(entry: CorpusEntry) -> str:
    return f"{VERDICTS[entry.verdict]} | {entry.line or ''} | {entry.rule}"
