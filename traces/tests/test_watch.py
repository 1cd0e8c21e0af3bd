"""Logs judged while they grow: as explain judges the complete logs, in constant memory."""

from __future__ import annotations

import gc
import json
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from merged_runs import Run, apart, killed, simulated, without_tx

from automcm_spec.vocabulary.application import Abort
from automcm_traces.explain.explain import exit_code, explain_file
from automcm_traces.explain.watch import Report, Watch
from automcm_traces.format.growing_file import GrowingFile, LineBuffer
from automcm_traces.format.reader import read
from automcm_traces.system.properties import judge

CUT = 4000
CORPUS = Path(__file__).parents[1] / "corpus"
INDEX = json.loads((CORPUS / "index.json").read_text())


def grown(
    paths: Sequence[Path], seed: int = 0, shift: Mapping[Path, int] | None = None
) -> tuple[Watch, list[Report]]:
    """The logs written in the order of their times, a few bytes or lines at a time."""
    chance, watch = random.Random(seed), Watch()
    buffers = {path: LineBuffer() for path in paths}
    pieces: list[tuple[int, Path, bytes]] = []
    for path in paths:
        watch.add(str(path), buffers[path])
        t_ms = 0
        for line in path.read_bytes().splitlines(keepends=True):
            found = json.loads(line).get("t_ms") if line.endswith(b"}\n") else None
            if isinstance(found, int):
                t_ms = max(t_ms, found - (shift or {}).get(path, 0))
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
    expected = explain_file(path)
    assert (verdict.verdict, verdict.finding) == (expected.verdict, expected.finding)
    assert watch.exit_code == exit_code([expected])
    assert [r.fields["line"] for r in reports if r.what == "verdict"] == [verdict.finding.at.line]
    assert verdict.sessions == expected.sessions[-10:]


def no_cancel(src: int, dst: int, m: Any, now: int) -> bool:
    return m.type == "Cancel" and (src, dst) == (2, 1)


def aborted(run: Run) -> None:
    run.drop = no_cancel
    run.simulation.command(2, Abort(session=(1, 1)), at=CUT)


def restarted(run: Run) -> None:
    run.simulation.restart(2, at=CUT)


def short_lease(run: Run) -> None:
    run.lease_ms = 1540
    aborted(run)


def cut_off(run: Run) -> None:
    run.drop = lambda src, dst, m, now: now >= CUT and 2 in (src, dst)


def nothing(run: Run) -> None:
    pass


FAULTS = [nothing, aborted, restarted, short_lease, cut_off]


def outlined(fields: Mapping[str, Any]) -> tuple[object, ...]:
    """What a hazard says that does not depend on how much of the logs is known."""
    names = ("session", "prescriber", "target", "since", "until", "fault", "ended", "excused")
    return tuple(str(fields[name]) for name in (*names, "outcome", "bound_ms"))


def found(reports: Sequence[Report]) -> list[tuple[object, ...]]:
    return [outlined(r.fields) for r in reports if r.what == "hazard" and not r.fields["open"]]


@pytest.mark.sweep(4)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_the_hazards_are_those_of_explain(
    fault: Callable[[Run], None], seed: int, tmp_path: Path
) -> None:
    run = Run(tmp_path, maneuver_ms=20_000, seed=seed + 1)
    fault(run)
    logs = run.logs(until=28_000)
    paths = [Path(log.file) for log in logs]
    expected = [outlined(h.as_dict()) for h in judge(logs).hazards]
    assert len(expected) == (fault is not nothing) or fault is cut_off
    watch, reports = grown(paths, seed)
    assert found(reports) == expected and watch.exit_code == 0
    assert [v.verdict for v in watch.verdicts] == ["allowed"] * 3


@pytest.mark.sweep(2)
@pytest.mark.parametrize("ahead", [0, 7, 100_000])
@pytest.mark.parametrize("named", [True, False])
def test_neither_other_clocks_nor_unnamed_transmissions_hide_a_hazard(
    ahead: int, named: bool, tmp_path: Path
) -> None:
    run = Run(tmp_path, maneuver_ms=20_000)
    aborted(run)
    run.logs(until=20_000)
    paths = [tmp_path / f"{n}.ndjson" for n in (1, 2, 3)]
    apart(read(paths[1]), paths[1], ahead)
    logs = [read(path) if named else without_tx(path) for path in paths]
    expected = [outlined(h.as_dict()) for h in judge(logs).hazards]
    assert len(expected) == 1
    assert found(grown(paths, shift={paths[1]: ahead})[1]) == expected


def test_a_log_that_falls_silent_is_a_hazard_before_the_prescriber_notices(tmp_path: Path) -> None:
    run = Run(tmp_path, maneuver_ms=20_000)
    cut_off(run)
    one, _, three = run.logs(until=20_000)
    dead = killed(tmp_path / "2.ndjson", CUT)
    paths = [Path(log.file) for log in (one, dead, three)]
    _, reports = grown(paths)
    hazards = [r.fields for r in reports if r.what == "hazard"]
    assert [h["open"] for h in hazards] == [True, False]
    assert found(reports) == [outlined(h.as_dict()) for h in judge([one, dead, three]).hazards]
    assert hazards[0]["since"] == hazards[1]["since"]
    noticed, left = (h["until_ms"] - hazards[0]["since_ms"] for h in hazards)
    assert 900 < noticed <= 1200 < left == run.left(1) - hazards[0]["since_ms"]


@pytest.mark.slow
def test_a_hazard_is_withdrawn_when_the_log_only_came_late(tmp_path: Path) -> None:
    run = Run(tmp_path, maneuver_ms=20_000)
    paths = [Path(log.file) for log in run.logs(until=28_000)]
    late = [r.what for r in grown(paths, shift={paths[1]: -1150})[1]]
    assert "hazard" in late and [w for w in late if w in ("hazard", "withdrawn")][-1] == "withdrawn"
    assert "hazard" not in [r.what for r in grown(paths, shift={paths[1]: -600})[1]]


def several() -> Iterator[list[Path]]:
    """The runs of several logs in the corpus."""
    for folder in sorted({path.parent for path in CORPUS.rglob("*.ndjson")}):
        if folder.name != "bad" and len(paths := sorted(folder.glob("*.ndjson"))) > 1:
            yield paths


@pytest.mark.sweep(2)
@pytest.mark.parametrize("paths", list(several()), ids=lambda paths: paths[0].parent.name)
def test_the_hazards_of_the_corpus_are_those_of_explain(paths: list[Path]) -> None:
    logs = [read(path) for path in paths]
    expected = judge(logs).hazards
    watch, reports = grown(paths)
    assert found(reports) == [outlined(h.as_dict()) for h in expected if not h.open]
    assert expected or not any(r.what == "hazard" for r in reports)
    bad = any(not h.excused or h.outcome == "exceeds" for h in expected)
    assert (watch.exit_code == 1) == (bad or exit_code(watch.verdicts) == 1)


def held(root: object) -> int:
    """The number of objects that an object holds, without modules, types and code."""
    seen: dict[int, object] = {}
    left = [root]
    while left:
        one = left.pop()
        if id(one) in seen or isinstance(one, type) or type(one).__name__ in NOT_HELD:
            continue
        seen[id(one)] = one
        if type(one).__name__ != "Specification":  # one cache for all logs, limited itself
            left += gc.get_referents(one)
    return len(seen)


NOT_HELD = ("module", "function", "builtin_function_or_method", "method", "frame")


@pytest.mark.slow
def test_memory_does_not_grow_with_the_logs(tmp_path: Path) -> None:
    """Sessions follow one another, so that windows, sessions and outboxes are all used."""
    asks = range(500, 200_000, 8000)
    paths = simulated(tmp_path, 1, 2, until=200_000, loss=0.1, asks=asks, target=2)
    lines = [path.read_bytes().splitlines(keepends=True) for path in paths]
    assert sum(map(len, lines)) > 10_000
    watch, buffers = Watch(), [LineBuffer() for _ in paths]
    for path, buffer in zip(paths, buffers, strict=True):
        watch.add(str(path), buffer)
    most: list[int] = []
    share = 100
    for n in range(share):
        for buffer, own in zip(buffers, lines, strict=True):
            buffer.put(b"".join(own[len(own) * n // share : len(own) * (n + 1) // share]))
        watch.advance()
        most.append(held(watch))
    third = share // 3
    assert max(most[2 * third :]) <= 1.1 * max(most[:third])


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
