"""Generated logs: both engines allow the good ones, and judge each edited one alike."""

from __future__ import annotations

import json

import agreement
import pytest
from generated_logs import mutated, of_the_reference


@pytest.mark.slow
def test_good_logs_are_allowed_and_both_engines_agree_on_edited_ones() -> None:
    assert agreement.main(60) == 0


@pytest.mark.slow
def test_an_edit_keeps_the_log_readable_and_the_same_seed_gives_the_same() -> None:
    for n, lines in enumerate(of_the_reference(20, 3)):
        edited, kind, line = mutated(lines, n)
        assert (edited, kind, line) == mutated(lines, n)
        numbers = [json.loads(text)["seq"] for text in edited[1:-1]]
        assert numbers == list(range(1, len(edited) - 1)), kind
        times = [json.loads(text)["t_ms"] for text in edited[1:-1]]
        assert times == sorted(times), kind
    assert of_the_reference(4, 3) == of_the_reference(4, 3) != of_the_reference(4, 4)
