"""One entry for each cause: five seeded bugs, each named by the first entry of the report."""

from __future__ import annotations

from pathlib import Path

import pytest
from broken_stations import CAUSES, broken
from report_stage import case, failure, run
from suite_stage import Suite
from suite_stage import conform as conform
from test_terminal_report import printed
from wrong_station import station

from automcm_conformance.exchange import deciding
from automcm_conformance.exchange.results import KEPT, Report, ids_of
from automcm_conformance.report import report, terminal_report
from automcm_spec.vocabulary.station import CONDITIONS

CASES = {
    "lease_counted_from_the_prescription": ("AMCM/RCV/NEG/TI-02", "ACT-4"),
    "an_ack_without_seq": ("AMCM/RCV/NEG/BV-01", "AMCM/PRE/ADV/BI-02"),
    "no_ack_of_a_copy": ("NEG-1", "ACT-4"),
    "an_old_cam_counts": ("ACT-5", "ACT-2"),
    "proposal_off_by_one": ("NEG-1", "NEG-3"),
}
"""Cases that fail for each bug, also some that are about another rule."""
LINES = 10


@pytest.mark.slow
@pytest.mark.parametrize("bug", CASES)
def test_the_first_entry_names_the_rule_and_the_cause(conform: Suite, bug: str) -> None:
    rule, operator, says = CAUSES[bug].values()
    found = conform(broken(bug), *CASES[bug])
    case, shown = found.causes[0][0]
    assert (case.verdict, shown.rule, shown.operator) == ("FAIL", rule, operator)
    assert len(shown.exchange) <= LINES, [line.text for line in shown.exchange]
    text = "\n".join(report.about(shown))
    assert says in text and f"{shown.timer}" in text
    failures = sum(len(each.failures) for each in found.cases)
    assert len(found.causes) < failures and sum(map(len, found.causes)) == failures
    begins_with_it(found, conform.folder)


def begins_with_it(found: Report, folder: Path) -> None:
    """The first cause comes before all tables: on the terminal, in HTML; JUnit and JSON name it."""
    case, shown = found.causes[0][0]
    html, junit = (path.read_text() for path in report.write(found, folder)[2:0:-1])
    terminal = printed(lambda console: terminal_report.summary(found, console))
    assert 0 < terminal.index(case.id) < terminal.index("transitions")
    assert 0 < html.index(case.id) < html.index("Cases by level and verdict")
    assert f"cause 1 of {len(found.causes)}, {shown.rule}: " in junit
    (listed, *_) = found.as_dict()["causes"]  # type: ignore[misc,attr-defined]
    assert listed["operator"] == shown.operator and listed["guard"] == shown.guard


def test_every_bug_is_tried() -> None:
    assert CASES.keys() == CAUSES.keys()


def test_guards_in_words_are_guards() -> None:
    assert deciding.MEANING.keys() <= {condition.text for condition in CONDITIONS}


def test_the_order_of_causes() -> None:
    """What casts doubt on the others, then FAIL by length, scenarios, ERROR."""
    kinds = {"a.b": 3, "Ack missing": 2, "phase": 1, KEPT: 9, "crash": 1}
    cases = []
    for n, (kind, lines) in enumerate(kinds.items()):
        wrong = failure()
        wrong.difference, wrong.exchange = kind, wrong.exchange[:1] * lines
        verdict = "ERROR" if kind in (KEPT, "crash") else "FAIL"
        name = f"AMCM/{'SYS' if kind == 'phase' else 'RCV'}/NEG/BI-0{n}"
        cases.append(case(name, verdict, failures=[wrong]))  # type: ignore[arg-type]
    found = run(*cases).causes
    assert [c[0][1].difference for c in found] == [KEPT, "Ack missing", "a.b", "phase", "crash"]


def test_a_field_is_one_cause_whatever_decided() -> None:
    wrong = [failure(), failure(), failure()]
    for n, each in enumerate(wrong):
        each.operator, each.difference = f"On{n}", "Ack.of.seq" if n < 2 else "Ack missing"
    found = run(*(case(f"AMCM/RCV/NEG/BI-0{n}", "FAIL", failures=[w]) for n, w in enumerate(wrong)))
    assert [(len(c), len(ids_of(c))) for c in found.causes] == [(2, 2), (1, 1)]


def test_a_malformed_message_is_shown_alone_and_with_its_fault(conform: Suite) -> None:
    code = """
def answer(c):
    out = right(c)
    if received(c, "Fin") and "seq" not in c["message"]:
        out["indications"] = []
    return out
"""
    found = conform(station(code), "AMCM/STA/END/BI-22", states=60)
    (cause,) = found.causes
    said = [line.text for line in cause[0][1].exchange]
    assert len(said) <= LINES and said[-2].endswith("; malformed: Fin with seq left out")
    report.write_pages(found, conform.folder / "report")
    page = (conform.folder / "report" / found.cases[0].page).read_text()
    assert "The verdict is that of the kit" in page and "DIVERGES" in page


def test_a_slow_adapter_is_named(conform: Suite) -> None:
    slow = "def answer(c):\n    time.sleep(0.03)\n    return right(c)"
    found = conform(station(slow), "AMCM/RCV/ADV/TI-03", states=60)
    assert found.notes and "ms an answer" in found.notes[0] and found.exit_code == 0
    assert "Note: the adapter is slow" in printed(lambda c: terminal_report.summary(found, c))


def test_act_5_a_timer_that_runs_on_is_laid_to_the_input_that_should_arm_it_again(
    conform: Suite,
) -> None:
    code = """
last = {}
def answer(c):
    out = right(c)
    if c["cmd"] == "receive" and c["message"]["type"] == "CAM":
        out = {**out, "deadline": last["deadline"]}
    last.update(out)
    return out
"""
    found = conform(station(code), "ACT-2", states=60)
    assert found.causes[0][0][1].rule == "ACT-5"


@pytest.mark.parametrize("name", ["generation_ms", r"generation\u005fms"])
def test_act_5_a_cam_that_was_due_before_has_no_new_mark(name: str, conform: Suite) -> None:
    code = f"""
def answer(c):
    out = right(c)
    for cam in out.get("cams", []):
        cam["marks"] = [list(mark) for mark in state().marks]
    return json.dumps(out).replace("generation_ms", r"{name}").encode() + b"\\n"
"""
    found = conform(station(code), "AMCM/STA/ADV/BV-02", states=60)
    assert (
        found.counts["FAIL"] == 1 and "CAM.marks: expected [] at 1100 ms" in found.cases[0].reason
    )
    assert found.causes[0][0][1].rule == "ACT-5"
