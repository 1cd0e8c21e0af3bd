"""What the pages show of code and of its output is so."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import pytest
from cli_stage import automcm
from page_texts import PLACES, TEXTS

ROOT = Path(__file__).resolve().parents[3]


def blocks(page: str) -> list[tuple[str, str]]:
    """The fenced blocks of a page: language, which may be empty, and text."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return re.findall(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_links_of_a_page_lead_somewhere(page: Path) -> None:
    """Where ``make pages`` has to come first, to the counterexample that the page is made of."""
    prose = re.sub(r"^```.*?^```$", "", TEXTS[page], flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\((?!https?:)([^)#\s]+)", prose):
        if target.startswith("counterexamples/"):
            name = Path(target).stem
            assert (ROOT / "traces" / "counterexamples" / f"{name}.itf.json").is_file(), target
        else:
            path = (page.parent / target).resolve()
            assert path.exists() or path in PLACES, target


def test_the_scenario_of_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    parts = blocks("adding-a-scenario.md")
    code = "\n".join(text for language, text in parts if language == "python")
    names: dict[str, object] = {"__name__": "page"}
    exec(compile(code, "<adding-a-scenario.md>", "exec"), names)
    assert [capsys.readouterr().out] == [text for language, text in parts if not language]

    logs = [str(path) for path in sorted(Path("runs/turn").iterdir())]
    answer = automcm("trace", "explain", *logs)
    assert answer.exit_code == 0, answer.output


def test_the_code_of_the_reference_s_page_prints_what_stands_below_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    parts = blocks("reference.md")
    shown = [(c, o[1]) for (kind, c), o in pairwise(parts) if kind == "python"]
    assert len(shown) == 1
    for code, printed in shown:
        exec(compile(code, "<reference.md>", "exec"), {})
        assert capsys.readouterr().out == printed
    logs = [str(path) for path in sorted(Path("runs/two").iterdir())]
    assert len(logs) == 2
    assert automcm("trace", "explain", *logs).exit_code == 0


def test_the_code_of_the_radio_s_page_prints_what_stands_below_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    (_, code), (_, printed) = blocks("radio.md")
    exec(compile(code, "<radio.md>", "exec"), {})
    assert capsys.readouterr().out == printed


@pytest.mark.slow
def test_the_counterexample_of_the_page_is_what_is_printed(tmp_path: Path) -> None:
    rule, printed = (text for _, text in blocks("reading-the-spec.md"))
    assert rule in (ROOT / "spec" / "tla" / "Station.tla").read_text()
    answer = automcm("spec", "check", "no_busy_refusal", "--traces", tmp_path)
    assert answer.exit_code == 0 and printed in answer.output


def test_the_code_of_the_compiled_station_prints_what_stands_below_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    (kind, code), (_, printed) = blocks("compiled-station.md")
    assert kind == "python"
    exec(compile(code, "<compiled-station.md>", "exec"), {})
    assert capsys.readouterr().out == printed
