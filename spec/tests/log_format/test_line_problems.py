"""Several faults in one line of a log: all are reported at once."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import pytest
from line_faults import Fault, apart, faults, with_faults

from automcm_maintenance.corpus.corpus import index
from automcm_traces.explain.lint import level, lint

Json = Any
CORPUS = Path(__file__).resolve().parents[3] / "traces" / "corpus"
GOOD = [e.file for e in index(CORPUS) if e.verdict == "allowed" and "bad/" not in e.file]
LINES = 40
"""Of each log only these lines are used, because each is checked again and again."""


def errors(folder: Path, lines: list[Json]) -> set[tuple[int, str, str]]:
    path = folder / "log.ndjson"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return {(f.at.line, f.rule, f.at.field) for f in lint(path) if level(f) == "error"}


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seed", range(12))
def test_mending_one_fault_reveals_no_other(seed: int, tmp_path: Path) -> None:
    chance = random.Random(seed)
    for _ in range(40):
        text_ = (CORPUS / chance.choice(GOOD)).read_text().splitlines()[:LINES]
        lines = [json.loads(line) for line in text_]
        at = chance.randrange(len(lines)) if chance.random() < 0.8 else 0
        possible = list(faults(lines[at]))
        chosen: list[Fault] = []
        for _ in range(chance.randint(2, 4)):
            left = [f for f in possible if all(apart(f, other) for other in chosen)]
            chosen += [chance.choice(left)] if left else []
        broken = [*lines[:at], with_faults(lines[at], chosen), *lines[at + 1 :]]
        found = errors(tmp_path, broken)
        fields = {field for line, _, field in found if line == at + 1}
        for fault in chosen:
            assert ".".join(fault.where) in fields, (fault, broken[at], found)
            rest = [one for one in chosen if one is not fault]
            mended = [*lines[:at], with_faults(lines[at], rest), *lines[at + 1 :]]
            assert errors(tmp_path, mended) <= found, (fault, broken[at])


def test_a_null_where_a_value_is_needed_says_so(tmp_path: Path) -> None:
    lines = [json.loads(line) for line in (CORPUS / GOOD[0]).read_text().splitlines()]
    lines[1]["seq"] = None
    path = tmp_path / "log.ndjson"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    [finding] = [f for f in lint(path) if f.at.line == 2]
    assert finding.observed == "null is not allowed, and the field is required"


def test_the_floats_of_one_list_are_one_finding(tmp_path: Path) -> None:
    lines = [json.loads(line) for line in (CORPUS / GOOD[0]).read_text().splitlines()]
    lines[1]["x_points"] = [[0.5, 1], [1.5, 2.5]]
    path = tmp_path / "log.ndjson"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    [finding] = [f for f in lint(path) if f.at.line == 2]
    assert finding.at.field == "x_points[0][0]"
    assert finding.observed == "must be an integer, not 0.5 (and 2 more in this list)"
