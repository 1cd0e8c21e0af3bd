"""Reports: valid files for any output of the tested program, and their contents."""

from __future__ import annotations

import json
from collections import Counter
from copy import deepcopy
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from junitparser import JUnitXml
from report_stage import case, failure, run
from report_stage import hostile as hostile

from automcm_conformance.exchange.results import Report
from automcm_conformance.report import report


class Tags(HTMLParser):
    """Counts tags and names of attributes, collects text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.count: Counter[str] = Counter()
        self.text = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.count.update([f"<{tag}>", *(f"{tag} {name}" for name, _ in attrs)])

    def handle_endtag(self, tag: str) -> None:
        self.count.update([f"</{tag}>"])

    def handle_comment(self, data: str) -> None:
        self.count.update(["comment"])

    def unknown_decl(self, data: str) -> None:
        self.count.update(["declaration"])

    def handle_data(self, data: str) -> None:
        self.text += data


def same(found: Report, wanted: Report) -> bool:
    return found.as_dict() == wanted.as_dict()


@pytest.mark.sweep(3)
def test_a_report_comes_back(hostile: Report, tmp_path: Path) -> None:
    files = report.write(hostile, tmp_path / "new" / "folder")
    assert [file.name for file in files] == ["report.json", "junit.xml", "report.html"]
    assert same(report.load(files[0]), hostile)


def test_equal_reports_are_equal_bytes_but_for_time(tmp_path: Path) -> None:
    one = run(case(), case("AMCM/PRE/ACT/TI-01", "FAIL", failures=[failure()]))
    other = replace(deepcopy(one), coverage=dict(reversed(one.coverage.items())))
    for name, value in (("a", one), ("b", other), ("c", replace(other, started="x", seconds=9.0))):
        report.write(value, tmp_path / name)
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes()
    junit = [(tmp_path / name / "junit.xml").read_text() for name in "ac"]
    timed = junit[1].replace('time="9.0"', 'time="1.5"').replace('"x"', '"2026-01-02T03:04:05Z"')
    assert junit[0] == timed != junit[1]
    first, second = (json.loads((tmp_path / name / "report.json").read_text()) for name in "ac")
    assert {key for key in first if first[key] != second[key]} == {"started", "seconds"}


@pytest.mark.parametrize(
    ("path", "value", "field"),
    [
        (("format",), "other/1", "format"),
        (("cases", 0, "verdict"), "GOOD", "cases.0.verdict"),
        (("cases", 0, "failures"), 5, "cases.0.failures"),
        (("implementation", "name"), None, "implementation.name"),
        (("coverage", "rules"), [2, 1], "coverage.rules"),
        (("coverage", "rules"), [1], "coverage.rules"),
        (("graphs", "text", "transitions"), [], "graphs.text.transitions"),
    ],
)
def test_a_bad_report_is_named(
    path: tuple[Any, ...], value: Any, field: str, tmp_path: Path
) -> None:
    data: Any = run(case()).as_dict()
    inner = data
    for step in path[:-1]:
        inner = inner[step]
    inner[path[-1]] = value
    file = tmp_path / "bad.json"
    file.write_text(json.dumps(data))
    with pytest.raises(ValueError, match=rf"bad\.json: {field}: "):
        report.load(file)


@pytest.mark.parametrize("data", [b"", b"[]", b"{", b"\xff", b"[" * 100_000, b'"automcm.report/1"'])
def test_what_is_no_report_is_named(data: bytes, tmp_path: Path) -> None:
    file = tmp_path / "bad.json"
    file.write_bytes(data)
    with pytest.raises(ValueError, match=r"bad\.json: "):
        report.load(file)


def test_junit_is_read_back(hostile: Report, tmp_path: Path) -> None:
    file = report.write(hostile, tmp_path)[1]
    suites = list(JUnitXml.fromfile(str(file)))
    assert sum(suite.tests for suite in suites) == len(hostile.cases)
    assert sum(suite.failures for suite in suites) == 1
    assert sum(suite.errors for suite in suites) == 1
    assert all(test.name and test.classname for suite in suites for test in suite)


def test_junit_says_what_the_exit_code_says(tmp_path: Path) -> None:
    wanted = {
        "BV-01": ("PASS", "PASS", None),
        "BI-01": ("FAIL", "PASS", ("Failure", "FAIL", "cause 1 of 1, NEG-4: what text")),
        "BI-02": ("INCONC", "PASS", ("Skipped", "INCONC", "why")),
        "BI-03": ("ERROR", "PASS", ("Error", "ERROR", "why")),
        "BI-04": ("SKIP", "PASS", ("Skipped", "SKIP", "why")),
        "BI-05": ("FAIL", "FAIL", ("Skipped", "FAIL", "expected: known")),
        "BI-06": ("PASS", "FAIL", ("Failure", "PASS", "FAIL was expected; why")),
        "BI-07": ("ERROR", "FAIL", ("Error", "ERROR", "FAIL was expected; why")),
        "BI-08": ("SKIP", "FAIL", ("Failure", "SKIP", "FAIL was expected; why")),
        "BI-09": ("PASS", "INCONC", ("Failure", "PASS", "INCONC was expected; why")),
    }
    cases = [
        case(
            f"AMCM/RCV/NEG/{name}",
            verdict,
            wanted=wants,
            because="" if wants == "PASS" else "known",
            reason="" if verdict == "FAIL" else "why",
            failures=[failure()] if name == "BI-01" else [],
        )
        for name, (verdict, wants, _) in wanted.items()
    ]
    whole = run(*cases, case("AMCM/SYS/REL/TI-01"))
    found = list(JUnitXml.fromfile(str(report.write(whole, tmp_path)[1])))
    assert [(suite.name, suite.tests) for suite in found] == [
        ("AMCM/RCV/NEG", 10),
        ("AMCM/SYS/REL", 1),
    ]
    for test, one in zip(found[0], cases, strict=True):
        got = [(type(r).__name__, r.type, r.message) for r in test.result]
        expected = wanted[one.id.rpartition("/")[2]][2]
        assert (test.name, test.classname) == (one.id, "AMCM.RCV.NEG")
        assert got == ([expected] if expected else [])
        skipped = not got or got[0][0] == "Skipped"
        assert (one.expected or one.verdict == "INCONC") == skipped
    text = list(found[0])[1].result[0].text
    for part in ("Station.tla, line 321", "allowed text", "came text", "1000 ms  station"):
        assert part in text


@pytest.mark.sweep(3)
def test_no_tag_of_the_page_is_from_the_station(hostile: Report) -> None:
    plain = deepcopy(hostile)
    text = "x"
    plain.implementation = run(text=text).implementation
    plain.graphs = run(text=text).graphs
    plain.problems = [text]
    for one in plain.cases:
        one.reason = one.reason and text
        one.because = one.because and text
        one.given = one.when = one.then = one.bug = one.cost = text
        one.failures = [failure(text) for _ in one.failures]
    plain.cases[1].id = "AMCM/RCV/other/BI-01"
    assert Tags(report.html([hostile])).count == Tags(report.html([plain])).count


def test_the_page_holds_nothing_that_cannot_be_printed(hostile: Report) -> None:
    page = report.html([hostile, hostile])
    assert all(char.isprintable() or char in "\n\t" for char in page)
    assert len(page) < 1_000_000
    page.encode()


def test_the_page_needs_nothing_from_outside() -> None:
    page = report.html([run(case(), case("AMCM/PRE/ACT/TI-01", "FAIL", failures=[failure()]))])
    tags = Tags(page)
    assert "http:" not in page and "https:" not in page and "url(" not in page
    assert not {"<link>", "<img>", "<iframe>", "script src"} & tags.count.keys()
    assert tags.count["a href"] == page.count('href="#') and page.count('href="#case-1-1"') == 1
    assert page.count('id="case-1-1"') == 1


def test_the_page_says_what_is_wrong() -> None:
    text = Tags(report.html([run(case("AMCM/PRE/ACT/TI-01", "FAIL", failures=[failure()]))])).text
    for part in (
        "Does not conform: 1 MUST case fails",
        "1,999 of 2,000 (99.9 %)",
        "Station.tla, line 321",
        "Expected one of",
        "automcm conform replay text",
        "Inconclusive",
        "2026-01-02",
    ):
        assert part in text


def test_headers_have_a_scope_and_headings_no_gap() -> None:
    tags = Tags(
        report.html([run(case(), case("AMCM/SYS/REL/TI-01", "FAIL", failures=[failure()]))])
    )
    assert tags.count["<th>"] == tags.count["th scope"]
    for tag in ("table", "tr", "td", "th", "dl", "dd", "details", "div", "span", "article", "ul"):
        assert tags.count[f"<{tag}>"] == tags.count[f"</{tag}>"], tag
    assert tags.count["<h1>"] == 1 and tags.count["<html>"] == 1


def test_implementations_stand_side_by_side() -> None:
    one = run(case(), case("AMCM/SYS/REL/TI-01"), text="Alpha")
    two = run(case(verdict="FAIL", failures=[failure()]), case("AMCM/STA/NEW/BI-01"), text="Beta")
    two.graphs = {}
    tags = Tags(report.html([one, two]))
    for part in ("Alpha 1.0", "Beta 1.0", "Conforms as", "Does not conform: 1", "not run"):
        assert part in tags.text
    assert tags.count["th colspan"] == 4
    assert [report.group(c) for c in one.cases + two.cases] == ["NEG", "REL", "NEG", "NEW"]
    assert report.groups([one, two]) == ["NEG", "REL", "NEW"]


def test_two_runs_of_one_implementation_have_numbers() -> None:
    before = run(case(verdict="FAIL", failures=[failure()]), text="Alpha")
    pages = [[before, run(case(), text="Alpha")], [before, run(case(), text="Beta")], [before]]
    texts = [Tags(report.html(page)).text for page in pages]
    assert "Conformance to AutoMCM: 2 runs" in texts[0]
    assert "Alpha 1.0 (run 1)" in texts[0] and "Alpha 1.0 (run 2)" in texts[0]
    assert not any("(run" in text for text in texts[1:])


@pytest.mark.parametrize(
    ("verdicts", "more", "wanted"),
    [
        ("PASS PASS", {}, (True, "Conforms as receiver: 2 of 2 MUST cases pass")),
        (
            "PASS SKIP SKIP",
            {},
            (True, "Conforms as receiver: 1 of 1 MUST cases pass; 2 MUST cases skipped"),
        ),
        ("FAIL ERROR", {}, (False, "Does not conform: 1 MUST case fails; 1 could not be judged")),
        ("FAIL FAIL", {}, (False, "Does not conform: 2 MUST cases fail")),
        ("PASS INCONC", {}, (None, "Cannot tell: 1 MUST case could not be judged")),
        ("SKIP", {}, (None, "Cannot tell: no MUST case was run; 1 MUST case skipped")),
        ("", {}, (None, "Cannot tell: no MUST case was run")),
        (
            "PASS",
            {"selectors": ["NEG"], "problems": ["late"]},
            (
                True,
                "Conforms as receiver: 1 of 1 MUST cases pass; only a part of the suite was run; "
                "1 problem in the run",
            ),
        ),
    ],
)
def test_the_sentence(verdicts: str, more: Any, wanted: tuple[bool | None, str]) -> None:
    cases = [case(verdict=verdict) for verdict in verdicts.split()]
    whole = run(*cases, case(level="MAY", verdict="FAIL"))
    assert report.conformance(replace(whole, **more)) == wanted


def test_an_expected_failure_does_not_conform() -> None:
    known = run(case(verdict="FAIL", wanted="FAIL", because="known"))
    assert known.exit_code == 0
    assert report.conformance(known)[0] is False
