"""The corpus is what would be generated now; a changed, missing or superfluous file is told."""

from __future__ import annotations

import pytest

from automcm_maintenance.documents import generated_files


def test_the_full_profile_compares_what_tlc_tells(monkeypatch: pytest.MonkeyPatch) -> None:
    """The behaviours are minutes of work, so here the logs on disk stand in for them."""
    there = {
        path: path.read_bytes()
        for kind in generated_files._FROM_TLC
        for path in (generated_files.CORPUS_ROOT / kind).rglob("*")
        if path.is_file()
    }
    assert (
        len(there) > 700 and generated_files._stale_corpus(generated_files._FROM_TLC, there) == []
    )
    gone = there.popitem()[0]
    (text,) = generated_files._stale_corpus(generated_files._FROM_TLC, there)
    assert gone.name in text
