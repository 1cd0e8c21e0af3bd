"""``lint --fix``: what it mends, and that it mends nothing else."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from line_faults import Fault, apart, faults, with_faults

from automcm_maintenance.corpus.corpus import index
from automcm_spec.support.bad_input import BadInput
from automcm_traces.explain.explain import explain_file
from automcm_traces.explain.lint import level, lint
from automcm_traces.explain.lint_fix import fix

Json = Any
CORPUS = Path(__file__).resolve().parents[1] / "corpus"
GOOD = [e.file for e in index(CORPUS) if e.verdict == "allowed" and "bad/" not in e.file]
JUDGED = [e for e in index(CORPUS) if e.verdict in ("allowed", "diverges") and not e.beside]


def in_seconds(lines: list[Json]) -> None:
    for line in lines:
        for name in ("t_ms", "deadline"):
            if name in line:
                line[name] = line[name] / 1000
        parameters = line.get("parameters", {})
        for name in [name for name in parameters if name.startswith("t_")]:
            parameters[name] = parameters[name] / 1000


def with_points(lines: list[Json]) -> None:
    for line in lines:
        line["seq"] = float(line.get("seq", 0))
    del lines[0]["seq"]


def from_0(lines: list[Json]) -> None:
    for line in lines[1:]:
        line["seq"] -= 1
    if len(lines) == 2:
        lines[1]["seq"] = 0


def not_counted(lines: list[Json]) -> None:
    for line in lines[1:-1]:
        del line["seq"]


def with_nulls(lines: list[Json]) -> None:
    for line in lines[1:-1]:
        line["rule"] = line["x_y"] = None


def more_fields(lines: list[Json]) -> None:
    for line in lines:
        line["host.name"] = {"load": 0.5, "of": [1.5, "a"]}
        line["rssi"] = -70.5


def names_as_text(lines: list[Json]) -> None:
    lines[0]["station"] = str(lines[0]["station"])


def unsorted(lines: list[Json]) -> None:
    lines[0]["complete"] = [*lines[0]["complete"], *reversed(lines[0]["complete"])]


def without_tx(lines: list[Json]) -> None:
    for line in lines[1:]:
        line.pop("tx", None)


WAYS: list[Callable[[list[Json]], None]] = [
    *(in_seconds, with_nulls, more_fields, names_as_text, unsorted, without_tx),
    *(with_points, from_0, not_counted),
]


def written(path: Path, lines: list[Json], end: str = "\n") -> Path:
    path.write_text("".join(json.dumps(line) + end for line in lines), newline="")
    return path


def read(path: Path) -> list[Json]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def without_what_is_new(lines: list[Json]) -> list[Json]:
    kept = [{k: v for k, v in line.items() if not k.startswith("x_")} for line in lines]
    return [{k: v for k, v in line.items() if k not in ("tx", "rule")} for line in kept]


def errors(path: Path) -> set[tuple[int, str, str]]:
    return {(f.at.line, f.rule, f.at.field) for f in lint(path) if level(f) == "error"}


@pytest.mark.parametrize("seed", range(8))
def test_what_is_mechanical_is_mended(seed: int, tmp_path: Path) -> None:
    """The copy is clean, has the events of the log before it was damaged, and the same verdict."""
    chance = random.Random(seed)
    for _ in range(5):
        entry = chance.choice(JUDGED)
        before = read(CORPUS / entry.file)
        lines = read(CORPUS / entry.file)
        ways = chance.sample(WAYS[:6], chance.randint(1, 6))
        ways += [chance.choice(WAYS[6:])] if chance.random() < 0.7 else []
        for way in ways:
            way(lines)
        end = chance.choice(["\n", "\r\n", "\n\n"])
        damaged = written(tmp_path / "damaged.ndjson", lines, end)
        unit = "s" if in_seconds in ways else None
        assert fix(damaged, tmp_path / "copy.ndjson", unit), (entry.file, ways)
        assert errors(tmp_path / "copy.ndjson") == errors(CORPUS / entry.file), (entry.file, ways)
        after = read(tmp_path / "copy.ndjson")
        assert without_what_is_new(after) == without_what_is_new(before), (entry.file, ways)
        verdict = explain_file(tmp_path / "copy.ndjson")
        assert (verdict.verdict, verdict.finding.at.line) == (entry.verdict, entry.line)
        assert fix(tmp_path / "copy.ndjson", tmp_path / "again.ndjson") == []


@pytest.mark.parametrize("seed", range(8))
def test_mending_makes_no_error(seed: int, tmp_path: Path) -> None:
    """Of any faults, those with no mechanical remedy are left, and nothing else."""
    chance = random.Random(seed)
    for _ in range(20):
        lines = read(CORPUS / chance.choice(GOOD))[:40]
        for at in chance.sample(range(len(lines)), 2):
            chosen: list[Fault] = []
            possible = list(faults(lines[at]))
            for _ in range(3):
                left = [f for f in possible if all(apart(f, other) for other in chosen)]
                chosen += [chance.choice(left)] if left else []
            lines[at] = with_faults(lines[at], chosen)
        damaged = written(tmp_path / "damaged.ndjson", lines)
        fix(damaged, tmp_path / "copy.ndjson")
        assert errors(tmp_path / "copy.ndjson") <= errors(damaged), lines
        assert fix(tmp_path / "copy.ndjson", tmp_path / "again.ndjson") == []


@pytest.mark.parametrize("file", random.Random(1).sample(GOOD, 5))
def test_a_clean_log_stays_as_it_is(file: str, tmp_path: Path) -> None:
    copy = tmp_path / "copy.ndjson"
    assert fix(CORPUS / file, copy) == [] and copy.read_bytes() == (CORPUS / file).read_bytes()


def test_a_gap_is_no_mistake_of_counting(tmp_path: Path) -> None:
    """Events are missing there: to count on would hide it. A repetition counts on."""
    lines = read(CORPUS / GOOD[0])
    kept = [*lines[:3], *lines[6:]]
    damaged = written(tmp_path / "damaged.ndjson", kept)
    assert fix(damaged, tmp_path / "copy.ndjson") == []
    kept[2]["seq"] = kept[1]["seq"]
    fix(written(damaged, kept), tmp_path / "copy.ndjson")
    seqs = [line["seq"] for line in read(tmp_path / "copy.ndjson")[1:]]
    assert seqs[:3] == [1, 2, 7] and seqs[-2] == seqs[-1]


@pytest.mark.parametrize("unit", ["us", "ns", "ms"])
def test_times_of_other_units(unit: Any, tmp_path: Path) -> None:
    lines = read(CORPUS / GOOD[0])
    times = {"us": 1000, "ns": 1_000_000, "ms": 1}[unit]
    for line in lines[1:-1]:
        for name in {"t_ms", "deadline"} & line.keys():
            line[name] = line[name] * times + (0.25 if unit == "ms" else 0)
    fix(written(tmp_path / "damaged.ndjson", lines), tmp_path / "copy.ndjson", unit)
    assert read(tmp_path / "copy.ndjson") == read(CORPUS / GOOD[0])


@pytest.mark.parametrize(
    "line",
    [
        b'{"rec":"event","seq":1,"seq":2,"t_ms":0,"ev":"restart"}\n',
        b'{"rec":"event","seq":1,"t_ms":NaN,"ev":"restart"}\n',
        b'{"rec":"event","seq":1,"t_ms":1e999,"ev":"restart"}\n',
        b'{"rec":"event","seq":1,"t_ms":0,"ev":"restart","x":"\\ud800"}\n',
        b"\xff\n",
        b"[" * 100_000 + b"\n",
        b'{"rec":"ev',
        b"\0" * 20,
    ],
)
def test_what_cannot_be_written_again_is_left(line: bytes, tmp_path: Path) -> None:
    header = (CORPUS / GOOD[0]).read_bytes().splitlines(keepends=True)[0]
    log, copy = tmp_path / "log.ndjson", tmp_path / "copy.ndjson"
    log.write_bytes(b"\xef\xbb\xbf" + header + line)
    assert [str(change) for change in fix(log, copy)] == ["byte order mark removed: line 1"]
    assert copy.read_bytes() == header + line


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(b"\x1f\x8b\x08\n")
    with pytest.raises(BadInput):
        fix(tmp_path / "log", tmp_path / "copy")
    assert not (tmp_path / "copy").exists()


def test_a_vendor_field_of_the_same_name_is_kept(tmp_path: Path) -> None:
    lines = read(CORPUS / GOOD[0])
    lines[1] |= {"rssi": -70, "x_rssi": -80}
    fix(written(tmp_path / "damaged.ndjson", lines), tmp_path / "copy.ndjson")
    mended = read(tmp_path / "copy.ndjson")[1]
    assert (mended["x_rssi"], mended["x_rssi_"]) == (-80, -70)
