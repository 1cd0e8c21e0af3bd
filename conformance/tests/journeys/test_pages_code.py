"""What the pages show of code and of its output is so."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from itertools import pairwise
from pathlib import Path

import pytest
from cli_stage import automcm
from page_texts import PAGES, PLACES, text

from automcm import kernels
from automcm.kernels.thin import prescription_bytes
from automcm_spec.graph import oracle, oracle_generation

ROOT = Path(__file__).resolve().parents[3]


def blocks(page: str) -> list[tuple[str, str]]:
    """The fenced blocks of a page: language, which may be empty, and text."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return re.findall(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_links_of_a_page_lead_somewhere(page: Path) -> None:
    """Where ``make pages`` has to come first, to the counterexample that the page is made of."""
    prose = re.sub(r"^```.*?^```$", "", text(page), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\((?!https?:)([^)#\s]+)", prose):
        if target.startswith("counterexamples/"):
            name = Path(target).stem
            assert (ROOT / "traces" / "counterexamples" / f"{name}.itf.json").is_file(), target
        else:
            path = (page.parent / target).resolve()
            assert path.exists() or path in PLACES, target


BAD, PAIR = "traces/corpus/bad", "traces/corpus/pair"


@pytest.mark.parametrize(
    ("page", "command"),
    [
        ("../README.md", f"trace explain {BAD}/ack_missing.ndjson"),
        ("trace-format.md", f"trace explain {BAD}/accepts_unasked.ndjson"),
        (
            "trace-format.md",
            f"trace show {PAIR}/1001.ndjson {PAIR}/2002.ndjson --session 1001/1 --no-timers",
        ),
        ("trace-format.md", f"trace shrink {BAD}/wrong_proposal.ndjson --out small"),
        (
            "trace-format.md",
            f"trace diff {PAIR}/2002.ndjson {BAD}/lease_longer.ndjson --times",
        ),
        pytest.param(
            "reference.md",
            "simulate lane-change --vehicles 4 --speed 30",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_an_excerpt_is_what_the_command_prints(
    page: str, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One block holds lines of the output, in this order."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "traces").symlink_to(ROOT / "traces")
    printed = [" ".join(line.split()) for line in automcm(*command.split()).stdout.splitlines()]
    excerpts = [text.splitlines() for language, text in blocks(page) if not language]
    (excerpt,) = [lines for lines in excerpts if " ".join(lines[0].split()) == printed[0]]
    rest = iter(printed)
    for line in excerpt:
        assert line.strip() in ("…", "...") or " ".join(line.split()) in rest, line


def test_the_readme_shows_the_size_and_the_hash_of_the_graph() -> None:
    graph = oracle.load(oracle_generation.ONE_PEER.path)
    states, transitions = len(graph.states), graph.transitions
    shown = f"Oracle      {states:,} states, {transitions:,} transitions, "
    (line,) = [x for x in text(ROOT / "README.md").splitlines() if x.startswith(shown)]
    assert line.endswith(f"spec {oracle_generation.spec_hash()[:12]}")


def test_the_signatures_of_the_kernels() -> None:
    modules = [
        importlib.import_module(f"{kernels.__name__}.{module.name}")
        for module in pkgutil.iter_modules(kernels.__path__)
    ]
    text = "".join(text for _, text in blocks("kernels.md"))
    shown = re.findall(r"^(\w+)\((.*?)\) ->", text, re.MULTILINE)
    assert len(shown) > 10
    for name, arguments in shown:
        (found,) = {vars(module)[name] for module in modules if name in vars(module)}
        real = inspect.signature(found)
        of_page = f"lambda {arguments}: 0"
        page = inspect.signature(eval(of_page, {"prescription_bytes": prescription_bytes}))
        plain = [p.replace(annotation=inspect.Parameter.empty) for p in real.parameters.values()]
        assert list(page.parameters.values()) == plain, name


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
