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


@pytest.mark.parametrize(
    ("page", "logs"),
    [("adding-a-scenario", 3), ("reference", 2), ("radio", 0), ("compiled-station", 0)],
)
def test_the_code_of_a_page_prints_what_stands_below_it(
    page: str,
    logs: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """And the logs that it writes are allowed."""
    monkeypatch.chdir(tmp_path)
    parts = blocks(f"{page}.md")
    code = "\n".join(text for language, text in parts if language == "python")
    exec(compile(code, f"<{page}.md>", "exec"), {"__name__": "page"})
    below = [(kind, text) for (above, _), (kind, text) in pairwise(parts) if above == "python"]
    assert [capsys.readouterr().out] == [text for kind, text in below if not kind]
    written = sorted(Path("runs").rglob("*.ndjson"))
    assert len(written) == logs
    assert not logs or automcm("trace", "explain", *written).exit_code == 0


@pytest.mark.slow
def test_the_counterexample_of_the_page_is_what_is_printed(tmp_path: Path) -> None:
    rule, printed = (text for _, text in blocks("reading-the-spec.md"))
    assert rule in (ROOT / "spec" / "tla" / "Station.tla").read_text()
    answer = automcm("spec", "check", "no_busy_refusal", "--traces", tmp_path)
    assert answer.exit_code == 0 and printed in answer.output
