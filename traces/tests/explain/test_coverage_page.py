"""The page of coverage: the figures and marks of the text, as colours of the lines."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

from automcm_spec.support.paths import TLA
from automcm_spec.vocabulary.condition_coverage import annotated
from automcm_traces.explain.coverage import LogCoverage, measure, text
from automcm_traces.explain.coverage_page import COLOURS, page

CORPUS = Path(__file__).parents[2] / "corpus"
PAIR = sorted((CORPUS / "pair").glob("*.ndjson"))
LINE = re.compile(
    r'<li class="(\w+)" id="L(\d+)">.*?<code>(.*?)</code><span class="notes">(.*?)</span></li>'
)


def lines(coverage: LogCoverage) -> dict[int, tuple[str, str, str]]:
    """By number: the colour, the text and the notes of each line of the page."""
    return {
        int(number): (colour, unescape(written), unescape(re.sub("<[^>]*>", "", notes)))
        for colour, number, written, notes in LINE.findall(page(coverage))
    }


def test_every_line_has_the_colour_of_its_mark_in_the_text() -> None:
    coverage = measure(PAIR)
    shown = lines(coverage)
    assert [shown[n][1] for n in sorted(shown)] == (TLA / "Station.tla").read_text().splitlines()
    marks = {
        int(line[6:10]): line[:5].strip()
        for line in annotated(coverage.conditions)
        if line[6:10].strip().isdigit()
    }
    assert {"both", "met", "never", "part"} <= set(marks.values()) <= set(COLOURS)
    for number, (colour, _, notes) in shown.items():
        assert colour == COLOURS[marks.get(number, "")]  # type: ignore[index]
        assert bool(notes) == (colour != "neutral")


def test_the_figures_are_those_of_the_text() -> None:
    coverage = measure([*PAIR, CORPUS / "bad/busy_accepted.ndjson"])
    made = page(coverage)
    told = text(coverage)
    assert told[0].replace(" ", "") in unescape(made).replace(" ", "")
    shares = re.findall(r'<th scope="row">(.*?)</th>.*?([\d,]+) of ([\d,]+)</td>', made)
    of_text = [re.match(r"(\S.*?) {2,}([\d,]+) of +([\d,]+) ", line) for line in told]
    assert shares == [match.groups() for match in of_text if match] and len(shares) == 7
    assert "busy_accepted.ndjson:" in made and "DIVERGES" in made
    shown = lines(coverage)
    for row in coverage.conditions.as_list():
        values = ", ".join(f"{v} {row[v]:,}" for v in ("true", "false") if row[v] is not None)
        assert f"{row['text']}: {values}" in shown[int(row["line"] or 0)][2]


def test_a_log_that_takes_a_line_changes_its_colour() -> None:
    coverage = LogCoverage()
    before = lines(coverage)
    assert {colour for colour, *_ in before.values()} == {"missed", "neutral"}
    changes = set()
    for log in [*PAIR, *sorted(CORPUS.glob("four-vehicles/*.ndjson"))]:
        coverage.add(log)
        after = lines(coverage)
        changes |= {(before[n][0], after[n][0]) for n in after if before[n][0] != after[n][0]}
        before = after
    assert changes == {("missed", "part"), ("missed", "taken"), ("part", "taken")}
    (request,) = (n for n, (_, written, _) in before.items() if "IF st.backoff THEN" in written)
    assert before[request][0] == "part" and "st.backoff: true 0, false " in before[request][2]
