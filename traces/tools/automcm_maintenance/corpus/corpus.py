"""The corpus: logs with their correct verdicts, and the index of these.

``traces/corpus/`` holds four folders:

* ``behaviours``: every transition of the stations of the closed models (``corpus_walks``);
* ``counterexamples``: the counterexamples of the must-fail models, as logs of their stations;
* ``bad``: good logs with one defect (``corpus_bad``);
* ``four-vehicles``, ``pair`` and ``secured``: runs of the reference.

The first two need TLC.  The rest, the index and its page are made from the files on disk.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from automcm_maintenance.corpus.corpus_bad import bad_logs, bases_among
from automcm_maintenance.corpus.corpus_walks import ModelGraph, Transition
from automcm_spec.model_checking import models
from automcm_spec.support import templates
from automcm_traces.explain.explain import verdict_of
from automcm_traces.export.itf_log import behaviour

WALKED = (
    "either_role",
    "probe_system",
    "restarts",
    "one_by_one_two_sessions",
    "two_by_one",
    "one_by_two",
    "unreduced",
    "probe_two_prescribers",
)
"""The closed models that are walked, in this order.

``one_by_three`` is omitted: its receivers have no ids, and a third one adds no behaviour."""
COVERAGE = "behaviours/coverage.json"


@dataclass(frozen=True, slots=True)
class CorpusEntry:
    """A log of the corpus with its correct verdict; ``file`` is relative to the corpus.

    ``line`` is 0 if the verdict names none.  ``beside`` is a log that must be checked with it.
    """

    file: str
    story: str
    verdict: str
    line: int = 0
    rule: str = ""
    beside: str = ""
    source: str = ""


def behaviours(notify: Callable[[str], None]) -> dict[str, bytes]:
    """The logs of walks that take every transition, by file, and the count; with TLC.

    Raises automcm_spec.model_checking.tlc.TlcError.
    """
    listed = {m.cfg: m for m in models.load()}
    seen: dict[int, set[Transition]] = {}
    files: dict[str, bytes] = {}
    counts: dict[str, object] = {}
    for name in WALKED:
        notify(f"corpus: {name}")
        graph = ModelGraph(listed[name])
        before = seen.setdefault(graph.max_rounds, set())
        walks = graph.walks(before)
        all_ = graph.transitions
        logs = graph.logs([(f"{name}-{n}", walk) for n, walk in enumerate(walks, 1)])
        for n, stations in enumerate(logs, 1):
            for station, text in stations.items():
                if not _silent(text):
                    files[f"behaviours/{name}/{n:03}-{station}.ndjson"] = text
        counts[name] = {
            "states": len(graph.nodes),
            "transitions": len(all_),
            "new": len(all_ - before),
            "walks": len(walks),
            "digests": sorted(t.digest for t in all_ - before),
        }
        before |= all_
    rows = [f"{json.dumps(name)}: {json.dumps(count)}" for name, count in counts.items()]
    files[COVERAGE] = ("{\n" + ",\n".join(rows) + "\n}\n").encode()
    return files


def counterexamples(folder: Path, notify: Callable[[str], None]) -> dict[str, bytes]:
    """The logs of every counterexample in ``folder`` that can have any, by file; with TLC.

    Raises automcm_spec.model_checking.tlc.TlcError, automcm_traces.export.itf.ItfError.
    """
    files = {}
    unsent = {m.cfg for m in models.load() if m.module in (*models.ALONE, *models.ATTACKED)}
    for path in sorted(folder.glob("*.itf.json")):
        if path.name.removesuffix(".itf.json") in unsent:
            continue
        found = behaviour(path)
        notify(f"corpus: {found.model}")
        for station, text in found.logs().items():
            if not _silent(text):
                files[f"counterexamples/{found.model}/{station}.ndjson"] = text
    return files


def _silent(text: bytes) -> bool:
    """Whether a log has no event, because the station did nothing in this behaviour."""
    return text.count(b"\n") <= 2


def rest(corpus: Path, runs: Mapping[str, bytes]) -> dict[str, bytes]:
    """The bad logs and the index, from the files in ``corpus`` and the ``runs`` of the reference.

    ``runs`` is by file, such as ``pair/1001.ndjson``.  Raises OSError.
    """
    logs = {
        path.relative_to(corpus).as_posix(): path.read_bytes()
        for kind in ("behaviours", "counterexamples")
        for path in sorted((corpus / kind).rglob("*.ndjson"))
    }
    walked = {file: text for file, text in logs.items() if file.startswith("behaviours/")}
    pair = {f"pair-{Path(f).stem}": text for f, text in runs.items() if f.startswith("pair/")}
    bad = list(bad_logs(pair | bases_among(list(walked.values()))))
    entries = [_of_run(file) for file in runs]
    entries += [_of_bad(name, seed, line) for name, seed, line, _ in bad]
    entries += [_of_walk(file, text) for file, text in walked.items()]
    entries += _of_counterexamples(corpus, [file for file in logs if file not in walked])
    files = dict(runs) | {f"bad/{name}.ndjson": text for name, _, _, text in bad}
    return files | {"index.json": index_text(entries)}


def index_text(entries: Iterable[CorpusEntry]) -> bytes:
    """The index: a JSON list with one log on each line and without empty fields."""
    lines = [
        json.dumps({k: v for k, v in asdict(e).items() if v or k == "line"}, ensure_ascii=False)
        for e in sorted(entries, key=lambda e: e.file)
    ]
    return ("[\n" + ",\n".join(lines) + "\n]\n").encode()


def index(corpus: Path) -> list[CorpusEntry]:
    """The entries of the index.  Raises OSError, ValueError."""
    return [CorpusEntry(**item) for item in json.loads((corpus / "index.json").read_text())]


_RUNS = {
    "four-vehicles": "The four vehicles of the paper, one copy in five lost: the third is the "
    "target, the others are released.",
    "pair": "A prescriber and a receiver that refuses once, a quarter of the copies lost.",
    "secured": "A prescriber and a receiver on secured links; an attacker forges, replays and "
    "changes messages.",
}


def _of_run(file: str) -> CorpusEntry:
    kind, name = file.split("/")
    story = f"{_RUNS[kind]} Station {Path(name).stem}."
    return CorpusEntry(file, story, "allowed", source="reference")


def _of_bad(name: str, seed: dict[str, Any], line: int) -> CorpusEntry:
    beside = f"pair/{seed['beside']}.ndjson" if "beside" in seed else ""
    about = seed["story"], seed["verdict"], line, seed.get("rule", ""), beside, seed["base"]
    return CorpusEntry(f"bad/{name}.ndjson", *about)


def _of_walk(file: str, text: bytes) -> CorpusEntry:
    """The entry of a walk: it is allowed because TLC took it; its story is its rules."""
    _, model, name = file.split("/")
    rules = dict.fromkeys(json.loads(line).get("rule") for line in text.splitlines())
    walk, station = Path(name).stem.split("-")
    story = (
        f"Walk {int(walk)} through {model}, station {station}: {', '.join(filter(None, rules))}."
    )
    return CorpusEntry(file, story, "allowed", source=f"spec/models/{models.LIST}#{model}")


def _of_counterexamples(corpus: Path, files: list[str]) -> Iterator[CorpusEntry]:
    """The engine's verdict on each station of a must-fail model, with the model's story."""
    why = {m.cfg: m for m in models.load()}
    for file in files:
        model, verdict = why[file.split("/")[1]], verdict_of(corpus / file)
        story = f"{model.cfg} breaks {model.property}, station {Path(file).stem}: {model.why}"
        source = f"spec/models/{models.LIST}#{model.cfg}"
        found = verdict.finding
        yield CorpusEntry(file, story, verdict.verdict, found.at.line, found.rule, source=source)


def page(corpus: Path) -> str:
    """docs/corpus.md: the contents of the corpus on disk, from its index."""
    entries = index(corpus)
    grouped = groupby(entries, lambda entry: entry.file.split("/")[0])
    by_kind = {kind: list(of) for kind, of in grouped}
    counts = json.loads((corpus / COVERAGE).read_text())
    walked = []
    for model in WALKED:
        files = [corpus / e.file for e in by_kind["behaviours"] if e.file.split("/")[1] == model]
        lines = sum(path.read_bytes().count(b"\n") for path in files)
        walked.append(counts[model] | {"model": model, "logs": len(files), "lines": lines})
    return templates.page(
        Path(__file__).with_name("corpus.md.j2"),
        logs=len(entries),
        of=by_kind,
        walked=walked,
        breaks={m.cfg: m.property for m in models.load()},
        short=lambda entry: entry.file.split("/", 1)[1],
    )
