"""The bench of the radio's encodings: its models are equal, and a violation is no figure."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from automcm_maintenance.benches import encodings_bench
from automcm_spec.model_checking import models, tlc
from automcm_spec.model_checking.models import PROPERTIES
from automcm_spec.support.paths import BENCH


def constants(cfg: str) -> dict[str, str]:
    return dict(re.findall(r"^  (\w+) = (.+)$", cfg, re.MULTILINE))


def test_the_encodings_are_measured_on_the_same_model() -> None:
    [config] = [m.config for m in models.load() if m.cfg == "one_by_one_two_sessions"]
    model = constants(config)
    assert constants((BENCH / "set.cfg").read_text()) == model
    for name in encodings_bench.NAIVE:
        naive = constants((BENCH / f"{name}.cfg").read_text())
        changed = {"Reduced": "FALSE", "Copies": naive["Copies"], "Seconds": naive["Seconds"]}
        assert naive == model | changed


def test_every_encoding_is_checked_for_s_1_to_s_5() -> None:
    wanted = {PROPERTIES[f"S-{n}"] for n in range(1, 6)}
    assert {path.stem for path in BENCH.glob("*.cfg")} == {"set", *encodings_bench.NAIVE}
    for path in BENCH.glob("*.cfg"):
        checked = {c.removeprefix("Naive") for c in models.checked_in(path.read_text())}
        assert checked == wanted


def test_a_violation_is_no_figure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    violates = tlc.TlcResult("violates", "NoHazardInv", 10, 20, 3, 1.0)
    monkeypatch.setattr(tlc, "run", lambda *args, **options: violates)
    with pytest.raises(AssertionError, match="set: NoHazardInv is violated"):
        encodings_bench.states("System", "set", tmp_path, 1)
