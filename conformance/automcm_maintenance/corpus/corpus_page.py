"""docs/corpus.md: the contents of the corpus, from its index."""

from __future__ import annotations

import json
from pathlib import Path

from automcm_maintenance.corpus.corpus import COVERAGE, WALKED, Entry
from automcm_spec.model_checking import models

VERDICTS = {
    "allowed": "allowed",
    "diverges": "diverges",
    "unreadable": "unreadable",
    "cannot_tell": "cannot tell",
}
HEAD = """# The corpus

Generated from `traces/corpus/index.json` by `make generate`.

`traces/corpus/` holds {logs} logs in the format `automcm.trace/1` and says of each what is right to
say of it: the verdict, the line in the file and the rule. `index.json` is a list with one object a
log: `file`, `story`, `verdict`, `line` (0: none), `rule` (absent: no rule called for the event),
`beside` (the log it must be judged with), `source`.

    automcm trace explain traces/corpus/bad/busy_accepted.ndjson

Whoever writes an engine of their own for this format can measure it by the index.

`automcm trace itf` turns a counterexample in ITF (`traces/counterexamples/`, `automcm spec check`)
into the logs of its stations, as here, with TLC; and a log into ITF, in which each state is the
station after a step, with the operator (`action`), what the event carried (`args`), the rule, the
line of the log and the place in Station.tla in its `#meta`.

    automcm trace itf traces/counterexamples/no_busy_refusal.itf.json --out runs
    automcm trace itf traces/corpus/pair/2002.ndjson --out runs

## Behaviours

Every transition of the stations of the closed models, at least once. A transition is a station's
state with an input that the model offers there; also one that changes nothing, such as a copy
heard twice. It is counted as the station sees it: itself is 1, the others are 2, 3, … in the order
in which state and input name them. TLC prints the graph of the model; a walk goes from the start
to the nearest transition that is still missing, and on from there. What each step puts out
(messages, timers, indications) is the word of TLC on `Step` (Station.tla). Made up are only ids,
content, seqs and times. So each of these logs is allowed, and each transition of the table is in
one of them.

Some models are reduced (System.tla): what they skip, a give-up or an answer, is told here step by
step. A model further down is walked only for what those above it, with as many rounds, do not
show. `one_by_three` is left out: its receivers have no ids.

| model | states | transitions | not shown above | walks | logs | lines |
|---|---:|---:|---:|---:|---:|---:|
"""
COUNTEREXAMPLES = """
## Counterexamples

What the must-fail models show (`docs/models.md`), as the logs of their stations; a station that
does nothing has none. Where a mechanism of the station is taken away, the log of the station that
misses it diverges. Where it is a bound, an order of timers or the radio, each log is allowed by
itself, and what breaks is a property of the whole. The verdicts are the engine's.
To look at one: `automcm trace html traces/counterexamples/retarget.itf.json --out retarget.html`.

| log | breaks | verdict | line | rule |
|---|---|---|---:|---|
"""
BAD = """
## One thing wrong

A good log with one small edit. The line that must be named follows from the edit: the line edited,
or the input of the step that lacks something.

| log | story | verdict | line | rule |
|---|---|---|---:|---|
"""
RUNS = """
## Runs of the reference

| log | story |
|---|---|
"""


def page(corpus: Path, index: bytes) -> str:
    """The page, with the counts of the walks from the corpus on disk."""
    entries = [Entry(**item) for item in json.loads(index)]
    by_kind: dict[str, list[Entry]] = {}
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
    for kind in ("four-vehicles", "pair"):
        for e in by_kind.get(kind, []):
            out.append(f"| `{e.file}` | {e.story} |\n")
    return "".join(out)


def _walked(corpus: Path, entries: list[Entry]) -> list[str]:
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


def _short(entry: Entry) -> str:
    return entry.file.split("/", 1)[1]


def _verdict_cells(entry: Entry) -> str:
    return f"{VERDICTS[entry.verdict]} | {entry.line or ''} | {entry.rule}"
