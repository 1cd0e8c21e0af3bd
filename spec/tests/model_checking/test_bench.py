"""The bench: its models, its conclusions, and real runs of small ones."""

import re
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from automcm_cli.main import app
from automcm_maintenance.benches import encoding_bench
from automcm_maintenance.benches.encoding_bench import EncodingFigures, Figure
from automcm_spec.model_checking import models, tlc
from automcm_spec.model_checking.models import PROPERTIES
from automcm_spec.support.paths import BENCH


def constants(cfg: str) -> dict[str, str]:
    return dict(re.findall(r"^  (\w+) = (.+)$", cfg, re.MULTILINE))


def figure(distinct_states: int, *, finished: bool) -> Figure:
    return Figure("x", "", distinct_states, distinct_states, 1, 1.0, finished)


def small(folder: Path, **changes: str) -> Path:
    """The cfgs of the bench with other constants."""
    for path in BENCH.glob("*.cfg"):
        text = path.read_text(encoding="utf-8")
        for name, value in changes.items():
            text = re.sub(rf"^  {name} = .*$", f"  {name} = {value}", text, flags=re.MULTILINE)
        (folder / path.name).write_text(text, encoding="utf-8")
    return folder


def test_the_encodings_are_measured_on_the_same_model() -> None:
    [config] = [m.config for m in models.load() if m.cfg == "one_by_one_two_sessions"]
    model = constants(config)
    assert constants((BENCH / "set.cfg").read_text()) == model
    for name in ("consumed_set", "bag"):
        naive = constants((BENCH / f"{name}.cfg").read_text())
        assert naive == model | {
            "Reduced": "FALSE",
            "Copies": naive["Copies"],
            "Seconds": naive["Seconds"],
        }


def test_every_encoding_is_checked_for_s_1_to_s_5() -> None:
    wanted = {PROPERTIES[f"S-{n}"] for n in range(1, 6)}
    assert {path.stem for path in BENCH.glob("*.cfg")} == set(encoding_bench.ENCODINGS)
    for name in encoding_bench.ENCODINGS:
        checked = {
            c.removeprefix("Naive") for c in models.checked_in((BENCH / f"{name}.cfg").read_text())
        }
        assert checked == wanted


@pytest.mark.parametrize(
    ("naive", "shown", "code"),
    [
        ([(200, True), (200, False)], True, 0),
        ([(199, True), (500, False)], False, 1),
        ([(199, False), (500, True)], None, 4),
    ],
)
def test_a_bound_too_low_is_no_verdict(
    naive: list[tuple[int, bool]], shown: bool | None, code: int
) -> None:
    figures = tuple(figure(n, finished=finished) for n, finished in naive)
    report = EncodingFigures(figure(10, finished=True), figures)
    assert (report.shown, report.exit_code) == (shown, code)
    assert report.as_dict()["encodings"][1]["ratio"] == naive[0][0] / 10


@pytest.mark.slow
def test_what_ends_in_time_is_finished(tmp_path: Path) -> None:
    folder = small(tmp_path, Receivers="{}", MaxSessions="1", MaxRounds="1")
    report = encoding_bench.run(3600, bench=folder)
    assert all(f.finished for f in (report.ours, *report.naive))
    assert report.exit_code == 1
    assert all(f.distinct_states > report.ours.distinct_states for f in report.naive)


def test_what_does_not_end_gives_a_lower_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(module: str, cfg: Path, *, on_progress: Any, **_: object) -> tlc.TlcResult:
        left = 0 if cfg.stem == "set" else 7
        on_progress(tlc.Progress(3, 200, 100, left))
        return tlc.TlcResult("holds", None, 100 * (1 + left), 200, 3, 1.0)

    monkeypatch.setattr(tlc, "run", run)
    result = CliRunner().invoke(app, ["spec", "bench", "--seconds", "1"])
    assert result.exit_code in (0, 4), result.output
    assert result.output.count("not finished") == 2
    assert re.search(r"^bag +>= [\d,]+ .* >= 8", result.output, re.MULTILINE), result.output


def test_a_violation_is_no_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    violates = tlc.TlcResult("violates", "NoHazardInv", 10, 20, 3, 1.0)
    monkeypatch.setattr(tlc, "run", lambda *args, **options: violates)
    result = CliRunner().invoke(app, ["spec", "bench"])
    assert result.exit_code == 3
    assert "set: NoHazardInv is violated" in result.output
