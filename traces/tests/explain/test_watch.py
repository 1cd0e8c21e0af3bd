"""Logs judged while they grow: as explain judges the complete logs, in constant memory."""

from __future__ import annotations

import gc
import json
import random
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from merged_runs import simulated

from automcm_spec.log_format.growing_file import GrowingFile, LineBuffer
from automcm_traces.explain import explain
from automcm_traces.explain.watch import Watch, WatchReport

CORPUS = Path(__file__).parents[2] / "corpus"
INDEX = json.loads((CORPUS / "index.json").read_text())


def grown(paths: Sequence[Path], seed: int = 0) -> tuple[Watch, list[WatchReport]]:
    """The logs written in the order of their times, a few bytes or lines at a time."""
    chance, watch = random.Random(seed), Watch()
    buffers = {path: LineBuffer() for path in paths}
    pieces: list[tuple[int, Path, bytes]] = []
    for path in paths:
        watch.add(path, buffers[path])
        t_ms = 0
        for line in path.read_bytes().splitlines(keepends=True):
            found = json.loads(line).get("t_ms") if line.endswith(b"}\n") else None
            t_ms = max(t_ms, found) if isinstance(found, int) else t_ms
            cut = chance.randrange(len(line))
            pieces += [(t_ms, path, line[:cut]), (t_ms, path, line[cut:])]
    pieces.sort(key=lambda piece: piece[0])
    reports = []
    for _, path, data in pieces:
        buffers[path].put(data)
        if chance.random() < 0.2:
            reports += watch.advance()
    return watch, reports + watch.finish()


@pytest.mark.sweep(60)
@pytest.mark.parametrize("case", INDEX, ids=lambda case: case["file"])
def test_the_verdict_on_a_log_that_grows_is_that_of_explain(case: dict[str, Any]) -> None:
    path = CORPUS / case["file"]
    watch, reports = grown([path])
    (verdict,) = watch.verdicts
    expected = explain.verdict_of(path)
    assert (verdict.verdict, verdict.finding) == (expected.verdict, expected.finding)
    assert watch.exit_code == explain.exit_code([expected])
    assert [r.fields["line"] for r in reports if r.what == "verdict"] == [verdict.finding.at.line]
    assert verdict.sessions == expected.sessions[-10:]


def several() -> Iterator[list[Path]]:
    """The runs of several logs in the corpus, but the largest."""
    folders = {path.parent for path in CORPUS.rglob("*.ndjson")}
    found = [sorted(folder.glob("*.ndjson")) for folder in folders if folder.name != "bad"]
    yield from sorted((paths for paths in found if 1 < len(paths) < 50), key=lambda p: (len(p), p))


@pytest.mark.sweep(2)
@pytest.mark.parametrize("paths", list(several()), ids=lambda paths: paths[0].parent.name)
def test_several_logs_are_judged_together_at_their_end(paths: list[Path]) -> None:
    watch, reports = grown(paths)
    assert [r.what for r in reports].count("together") == 1 and reports[-1].what == "together"
    found = [explain.judged_log(path) for path in paths]
    assert reports[-1].fields == explain.verdicts_together(found)[1].as_dict()
    assert watch.exit_code == (
        1
        if explain.verdicts_together(found)[1].verdict == "violated"
        else explain.exit_code(explain.verdicts(found))
    )


def test_a_forged_message_is_found_where_the_logs_cannot_be_merged() -> None:
    paths = [CORPUS / "pair/1001.ndjson", CORPUS / "bad/forged_content.ndjson"]
    watch, reports = grown([*paths, CORPUS / "four-vehicles/4004.ndjson"])
    (forged,) = (r for r in reports if r.fields.get("rule") == "forged")
    assert (forged.what, forged.fields["line"], watch.exit_code) == ("verdict", 23, 1)


def test_a_divergence_counts_although_the_file_is_another_now(tmp_path: Path) -> None:
    path, good = tmp_path / "1001.ndjson", CORPUS / "pair/1001.ndjson"
    path.write_bytes(good.read_bytes())
    watch, buffers = Watch(), (LineBuffer(), LineBuffer())
    for each, buffer in zip((path, CORPUS / "pair/2002.ndjson"), buffers, strict=True):
        watch.add(each, buffer)
    buffers[0].put((CORPUS / "bad/ack_missing.ndjson").read_bytes())
    assert watch.finish() and watch.exit_code == 1


def held(root: object) -> int:
    """The number of objects that an object holds, without modules, types and code."""
    seen: dict[int, object] = {}
    left = [root]
    while left:
        one = left.pop()
        if id(one) in seen or isinstance(one, type) or type(one).__name__ in NOT_HELD:
            continue
        seen[id(one)] = one
        if type(one).__name__ != "_lru_cache_wrapper":  # one cache for all logs, limited itself
            left += gc.get_referents(one)
    return len(seen)


NOT_HELD = ("module", "function", "builtin_function_or_method", "method", "frame")


@pytest.mark.slow
def test_memory_does_not_grow_with_the_logs(tmp_path: Path) -> None:
    """Sessions follow one another, so that sessions and outboxes are used."""
    asks = range(500, 200_000, 8000)
    paths = simulated(tmp_path, 1, 2, until=200_000, loss=0.1, asks=asks, target=2)
    lines = [path.read_bytes().splitlines(keepends=True) for path in paths]
    assert sum(map(len, lines)) > 10_000
    watch, buffers = Watch(), [LineBuffer() for _ in paths]
    for path, buffer in zip(paths, buffers, strict=True):
        watch.add(path, buffer)
    most: list[int] = []
    share = 100
    for n in range(share):
        for buffer, own in zip(buffers, lines, strict=True):
            buffer.put(b"".join(own[len(own) * n // share : len(own) * (n + 1) // share]))
        watch.advance()
        most.append(held(watch))
    third = share // 3
    assert max(most[2 * third :]) <= 1.1 * max(most[third : 2 * third])


def test_lines_come_whole_from_a_file_that_grows(tmp_path: Path) -> None:
    path = tmp_path / "log"
    file = GrowingFile(path)
    assert file.readline(100) == b"" and file.change() == "missing"
    path.write_bytes(b"one\ntw")
    assert [file.readline(100) for _ in range(2)] == [b"one\n", b""]
    with path.open("ab") as out:
        out.write(b"o\nthree")
    assert [file.readline(100) for _ in range(2)] == [b"two\n", b""] and file.change() == ""
    assert file.readline(3) == b"thr", "a line that is too long is not read further"
    file.finish()
    assert file.readline(100) == b"ee" and file.readline(100) == b""
    path.write_bytes(b"new\n")
    assert file.change() == "truncated"
    path.rename(tmp_path / "old")
    assert file.change() == ""
    path.write_bytes(b"another\n")
    assert file.change() == "replaced"
    file.close()
