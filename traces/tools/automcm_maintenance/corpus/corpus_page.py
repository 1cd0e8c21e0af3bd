"""docs/corpus.md: the contents of the corpus, from its index."""

from __future__ import annotations

import json
from collections import defaultdict
from pathlib import Path

from automcm_maintenance.corpus.corpus import COVERAGE, WALKED, CorpusEntry, index
from automcm_spec.model_checking import models
from automcm_spec.support import markdown

TEMPLATE = Path(__file__).with_name("corpus.md.j2")


def page(corpus: Path) -> str:
    """The page of the corpus on disk."""
    entries = index(corpus)
    by_kind: dict[str, list[CorpusEntry]] = defaultdict(list)
    for entry in entries:
        by_kind[entry.file.split("/")[0]].append(entry)
    counts = json.loads((corpus / COVERAGE).read_text())
    walked = []
    for model in WALKED:
        files = [corpus / e.file for e in by_kind["behaviours"] if e.file.split("/")[1] == model]
        lines = sum(path.read_bytes().count(b"\n") for path in files)
        walked.append(counts[model] | {"model": model, "logs": len(files), "lines": lines})
    return markdown.page(
        TEMPLATE,
        logs=len(entries),
        of=by_kind,
        walked=walked,
        breaks={m.cfg: m.property for m in models.load()},
        short=lambda entry: entry.file.split("/", 1)[1],
    )
