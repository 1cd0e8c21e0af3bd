"""The documents for adapter authors agree with the reference and the specification."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from automcm.adapters.adapter_lines import serve
from automcm_cli.main import app
from automcm_conformance.adapter.protocol import INDICATIONS
from automcm_conformance.exchange.results import (
    EXPLORED,
    VERDICTS,
    CaseResult,
    Exploration,
    Failure,
    Implementation,
    Line,
    Report,
    Verdict,
)
from automcm_conformance.suite.purposes import load as load_purposes
from automcm_conformance.suite.verdicts import expectations
from automcm_spec.graph.oracle import load
from automcm_spec.graph.oracle_generation import TIGHT, TWO_PEERS

DOCS = Path(__file__).resolve().parents[3] / "docs"
FREE = {"rule", "detail", "version"}
"""Fields of an answer that are not compared; the version changes with each release."""


def section(page: str, heading: str) -> str:
    """What stands under a heading, up to the next of the same depth or the end."""
    text = (DOCS / page).read_text(encoding="utf-8")
    begin = text.index(f"\n{heading}\n") + 1
    end = text.find("\n" + heading.split()[0] + " ", begin + 1)
    return text[begin:end] if end > 0 else text[begin:]


def exchange() -> list[tuple[str, str]]:
    """The lines of the exchange in adapter.md: ``>`` or ``<``, and the line."""
    block = section("adapter.md", "## A whole exchange").split("```")[1]
    return [(line[0], line[2:]) for line in block.strip().splitlines()]


def plain(value: Any) -> Any:
    """Without the parts that are not compared."""
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items() if name not in FREE}
    return [plain(each) for each in value] if isinstance(value, list) else value


def test_the_exchange_in_the_document_is_what_the_reference_answers() -> None:
    said = exchange()
    asked = [line for who, line in said if who == ">"]
    written = [json.loads(line) for who, line in said if who == "<"]
    answers = [json.loads(line) for line in serve(f"{line}\n".encode() for line in asked)]
    assert len(asked) == len(written) + 1 == 11  # stop has no answer
    assert "".join(who for who, _ in said) == "><" * len(written) + ">"
    assert plain(answers) == plain(written)


@pytest.fixture(scope="module")
def told() -> set[tuple[str, str]]:
    """What the application is told in the graphs, and by which rule."""
    found = set()
    for graph in (TWO_PEERS, TIGHT):
        for effect in load(graph.path).effects:
            name, *reason = effect.indication
            if effect.rule == "END-2" and reason:
                reason = ["reason"]  # whatever the Cancel says
            if name != "nothing":
                found.add((f"{name}({reason[0]})" if reason else name, effect.rule))
    return found


def table(page: str, head: str) -> list[list[str]]:
    """The rows of the table whose head begins with ``head``."""
    text = (DOCS / page).read_text(encoding="utf-8")
    lines = text[text.index(f"\n| {head} |") + 1 :].split("\n\n")[0].splitlines()
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines[2:]]


@pytest.mark.slow
def test_the_protocol_lists_all_that_is_told_and_by_which_rule(told: set[tuple[str, str]]) -> None:
    rows = table("protocol.md", "indication")
    listed = [(row[0].strip("`"), rule) for row in rows for rule in row[-1].split(", ")]
    assert sorted(listed) == sorted(told)


@pytest.mark.slow
def test_the_adapter_page_names_the_same_rules(told: set[tuple[str, str]]) -> None:
    text = section("adapter.md", "### Indications")
    listed = {
        (name, rule)
        for name, rules in re.findall(r"^\| `(\w+)` \|.*\| ([A-Z0-9, -]+) \|$", text, re.MULTILINE)
        for rule in rules.split(", ")
    }
    assert listed == {(name.split("(")[0], rule) for name, rule in told}
    assert {name for name, _ in listed} == set(INDICATIONS)


def page(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def test_the_expectations_in_the_guide_can_be_read(tmp_path: Path) -> None:
    example = page("conformance.md").split("```toml\n")[1].split("```")[0]
    (tmp_path / "known.toml").write_text(example)
    known = expectations(tmp_path / "known.toml", load_purposes())
    assert known == {"AMCM/RCV/NEG/BI-03": ("FAIL", "ticket 12")}


def test_the_guide_names_every_verdict_field_and_option() -> None:
    text = page("conformance.md")
    assert [row[0] for row in table("conformance.md", "verdict")] == list(VERDICTS)
    for kind in (CaseResult, Failure, Line, Report):
        missing = {f.name for f in fields(kind) if f"`{f.name}`" not in text}
        assert missing <= {"broke"}, kind.__name__  # which is the exit code
    for command, heading in (("run", "## From nothing to a report"), ("explore", "## Exploring")):
        found = get_command(app).commands["conform"].commands[command]  # type: ignore[attr-defined]
        options = {option for each in found.params for option in each.opts} - {"--help"}
        named = set(re.findall(r"`(--[\w-]+)", section("conformance.md", heading)))
        assert {option for option in options if option.startswith("-")} == named, command


def test_the_guide_names_what_an_exploration_holds() -> None:
    text = section("conformance.md", "## Exploring")
    missing = {f.name for f in fields(Exploration) if f"`{f.name}`" not in text}
    assert missing <= {"broke"} and EXPLORED in text  # which is the exit code


@pytest.mark.parametrize(
    ("verdicts", "code"),
    [
        (["PASS", "SKIP"], 0),
        (["FAIL", "ERROR", "INCONC"], 1),
        (["ERROR", "INCONC"], 3),
        (["INCONC"], 4),
    ],
)
def test_the_exit_codes_are_those_of_the_guide(verdicts: list[Verdict], code: int) -> None:
    assert exit_code(*((verdict, "PASS") for verdict in verdicts)) == code
    assert any(row[0] == str(code) for row in table("conformance.md", "exit code"))


def test_a_known_deviation_that_is_gone_counts() -> None:
    assert exit_code(("FAIL", "FAIL")) == 0
    assert exit_code(("PASS", "FAIL")) == exit_code(("SKIP", "FAIL")) == 1


def exit_code(*cases: tuple[Verdict, Verdict]) -> int:
    """Of a run with these verdicts, each with the one that was wanted."""
    who = Implementation("a", "1", "", [], ["lane_change"], {}, ["a"])
    results = [
        CaseResult(f"c{n}", verdict, [], "MUST", "", "", "", "", "", wanted=wanted)
        for n, (verdict, wanted) in enumerate(cases)
    ]
    return Report(who, results, {}, {}, "", 1, []).exit_code
