"""The corpus is what would be generated now; a changed, missing or superfluous file is told."""

from __future__ import annotations

from automcm_maintenance.documents.generated_files import _FROM_TLC, CORPUS_ROOT, Generated


def test_the_full_profile_compares_what_tlc_tells() -> None:
    """The behaviours are minutes of work, so here the logs on disk stand in for them."""
    there = {
        path: path.read_bytes()
        for folder in _FROM_TLC
        for path in folder.rglob("*")
        if path.is_file()
    }
    corpus = Generated(CORPUS_ROOT, lambda: there, _FROM_TLC)
    assert len(there) > 700 and corpus.drift() == []
    superfluous, changed, *_ = sorted(there)
    del there[superfluous]
    there |= {changed: b"another", _FROM_TLC[1] / "missing.ndjson": b""}
    told = [text.split(":")[0].split("/")[-1] for text in corpus.drift()]
    assert told == [superfluous.name, changed.name, "missing.ndjson"]
