"""Generated logs: the good ones are allowed, and each edit is caught or rightly allowed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from agreement import reason
from generated_logs import KINDS, Lines, mutated, of_the_model, of_the_reference

from automcm_traces.explain.explain import Verdict, verdicts_of

NUMBER = 60
OF_THE_MODEL = 16


def modelled() -> list[Lines]:
    return of_the_model(OF_THE_MODEL, 7, depth=40)


@pytest.fixture(scope="module")
def good() -> list[Lines]:
    """The first are of the model."""
    return modelled() + of_the_reference(NUMBER - OF_THE_MODEL, 7)


def judged(lines: Lines, folder: Path) -> Verdict:
    path = folder / "log.ndjson"
    path.write_text("\n".join(lines) + "\n")
    (verdict,) = verdicts_of([path])
    return verdict


@pytest.mark.slow
def test_good_logs_of_model_and_reference_are_allowed(good: list[Lines], tmp_path: Path) -> None:
    assert len(good) == NUMBER and sum(map(len, good)) > 20 * NUMBER
    verdicts = [judged(lines, tmp_path) for lines in good]
    assert [v for v in verdicts if v.verdict != "allowed"] == []


@pytest.mark.slow
def test_each_edit_is_caught_at_its_line_or_there_is_a_reason(
    good: list[Lines], tmp_path: Path
) -> None:
    kinds, caught, odd = set(), 0, []
    for n, lines in enumerate(good * 3):
        edited, kind, line = mutated(lines, n)
        verdict = judged(edited, tmp_path)
        kinds.add(kind)
        caught += verdict.verdict != "allowed"
        if not reason(lines, edited, kind, line, verdict.verdict, verdict.finding.at.line):
            odd.append((n, kind, line, verdict.verdict, verdict.finding.at.line))
    assert kinds == set(KINDS) and caught > NUMBER
    assert odd == []


@pytest.mark.slow
def test_an_edit_keeps_the_log_readable_and_is_the_same_for_the_same_seed(
    good: list[Lines],
) -> None:
    for n, lines in enumerate(good):
        edited, kind, line = mutated(lines, n)
        assert (edited, kind, line) == mutated(lines, n)
        numbers = [json.loads(text)["seq"] for text in edited[1:-1]]
        assert numbers == list(range(1, len(edited) - 1)), kind
        times = [json.loads(text)["t_ms"] for text in edited[1:-1]]
        assert times == sorted(times), kind


@pytest.mark.slow
def test_the_same_seed_gives_the_same_logs(good: list[Lines]) -> None:
    assert of_the_reference(4, 3) == of_the_reference(4, 3) != of_the_reference(4, 4)
    assert modelled() == good[:OF_THE_MODEL]
