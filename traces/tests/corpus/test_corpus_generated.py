"""The corpus is what would be generated now; a changed, missing or superfluous file is told."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from automcm_maintenance.documents import generated_files

CODE = (
    "import hashlib, json; from automcm_maintenance.documents import generated_files as g;"
    "print(json.dumps({str(p): hashlib.sha256(d).hexdigest() for p, d in g._corpus().items()}))"
)


@pytest.mark.slow
def test_what_needs_no_tlc_is_not_stale_and_each_drift_is_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    files = generated_files._corpus()
    assert generated_files._stale_corpus(generated_files._AT_ONCE, files) == []
    changed = generated_files.CORPUS_ROOT / "bad" / "cut.ndjson"
    missing = generated_files.CORPUS_ROOT / "bad" / "none.ndjson"
    stale = generated_files._stale_corpus(
        generated_files._AT_ONCE,
        {p: d for p, d in files.items() if p.name != "empty.ndjson"} | {changed: b"", missing: b""},
    )
    assert [text.split(":")[0].split("/")[-1] for text in stale] == [
        "cut.ndjson",
        "empty.ndjson",
        "none.ndjson",
    ]
    assert all("make generate" in text for text in stale)


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


@pytest.mark.slow
@pytest.mark.parametrize("seed", ["1", pytest.param("2", marks=pytest.mark.deep)])
def test_the_corpus_does_not_depend_on_the_hash_seed(seed: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", CODE],
        env=os.environ | {"PYTHONHASHSEED": seed},
        cwd=Path(__file__).parents[3],
        capture_output=True,
        check=True,
    )
    made = json.loads(done.stdout)
    there = {name: hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in made}
    assert len(made) > 50 and made == there
