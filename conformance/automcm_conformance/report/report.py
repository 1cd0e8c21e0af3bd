"""A run as files: report.json to read again, junit.xml for CI, report.html for people.

Much of a report is text of a program under test.  Whatever is shown of it goes through ``visible``.
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from junitparser import Error, JUnitXml, Skipped, TestCase, TestSuite
from junitparser import Failure as Failed
from pydantic import TypeAdapter, ValidationError

from automcm_conformance.exchange.results import (
    FORMAT,
    VERDICTS,
    CaseResult,
    Failure,
    Level,
    Report,
    Verdict,
)
from automcm_spec.support import files
from automcm_spec.support.bad_input import BadInput
from automcm_traces.viewer import page as page_
from automcm_traces.viewer.page_data import load as load_logs
from automcm_traces.viewer.page_run import PageError

LEVELS: tuple[Level, ...] = ("MUST", "SHOULD", "MAY")
GROUPS = {
    "ADV": "advertising",
    "PRE": "prescribing",
    "NEG": "negotiating",
    "ACT": "actuating",
    "END": "ending",
    "REL": "reliable sending",
    "CMD": "commands",
    "MSG": "addressing",
    "MEM": "memory",
}
MEANING: dict[Verdict, str] = {
    "PASS": "Every answer was one that the specification allows.",
    "FAIL": "An answer came that the specification does not allow, or one that it asks for did not "
    "come.",
    "INCONC": "Inconclusive: what leads to the test went wrong, so the test itself says nothing.",
    "SKIP": "Not run, because the implementation does not claim what is tested. Counts neither for "
    "nor against it.",
    "ERROR": "The kit or the adapter broke: a process that ended, an answer that came too late or "
    "was none.",
}
TOTALS = ("transitions", "refusals", "rules")
MOST = 20
"""Pages of one run; what is beyond has its log."""
LIMIT = 4000
"""How many characters of one text are shown; report.json holds all."""
_REPORT = TypeAdapter(Report)


def write(report: Report, folder: Path) -> list[Path]:
    """Write report.json, junit.xml and report.html; the folder is made if it is not there.

    Equal reports give equal bytes; what ``started`` and ``seconds`` say stands in report.json and
    report.html only.  Raises OSError if a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / name for name in ("report.json", "junit.xml", "report.html")]
    text = json.dumps(report.as_dict(), indent=2, sort_keys=True) + "\n"
    files.write(paths[0], text)
    with files.writing(paths[1]) as junit:
        _junit(report).write(junit, pretty=True)
    files.write(paths[2], html([report]))
    return paths


def write_pages(report: Report, folder: Path) -> None:
    """Write a page beside the log of each case that is no PASS, and name it in the report.

    Raises OSError if it cannot be written.
    """
    for case in [c for c in report.cases if c.log and c.verdict not in ("PASS", "SKIP")][:MOST]:
        log = folder / case.log
        several = log.parent != folder / "logs"
        logs = sorted(log.parent.glob("*.ndjson")) if several else [log]
        try:
            page = load_logs(logs, f"{case.id}: {case.verdict}")
        except (BadInput, PageError):
            continue  # the log is there all the same
        if not several and page.runs[0].verdicts[0].verdict == "allowed":
            page.title = f"{case.id}, up to where it failed"  # which a log cannot always tell
            what = case.failures[0].what if case.failures else case.reason
            page.note = f"Judged up to the end of the log. {case.verdict}, after that: {what}"
        page.runs[0].renamed = f"{folder}/", ""
        path = log.with_suffix(".html")
        files.write(path, page_.html(page))
        case.page = path.relative_to(folder).as_posix()


def load(path: Path) -> Report:
    """The report in a report.json.

    Raises ValueError, naming file and field, if it is none; OSError if it cannot be read.
    """
    try:
        value = json.loads(path.read_text("utf-8"))
        if not isinstance(value, dict) or value.get("format") != FORMAT:
            raise ValueError(f"format: {FORMAT} is needed")
        return _REPORT.validate_python(value)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"])
        raise ValueError(visible(f"{path}: {field}: {first['msg']}")) from None
    except (ValueError, RecursionError) as error:
        raise ValueError(visible(f"{path}: {error}")) from None


def html(reports: list[Report]) -> str:
    """One page that needs nothing else, for one implementation or several side by side.

    Raises ValueError if there is no report.
    """
    if not reports:
        raise ValueError("no report to show")
    page = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_shown,
        trim_blocks=True,
        lstrip_blocks=True,
    ).get_template("report.html.j2")
    names = Counter((r.implementation.name, r.implementation.version) for r in reports)
    cases = {case.id: case for report in reversed(reports) for case in reversed(report.cases)}
    text = page.render(
        reports=reports,
        twice=lambda r: names[r.implementation.name, r.implementation.version] > 1,
        cases=list(reversed(cases.values())),
        results=[{case.id: n for n, case in enumerate(report.cases)} for report in reports],
        graphs=sorted({name for report in reports for name in report.graphs}),
        kinds=_ordered({kind for r in reports for pairs in r.graphs.values() for kind in pairs}),
        matrices=[matrix(report) for report in reports],
        rows=groups(reports),
        conformance=conformance,
        levels=levels,
        share=share,
        totals=totals,
        wrong=[wrong(report) for report in reports],
        TOTALS=TOTALS,
        GROUPS=GROUPS,
        LEVELS=LEVELS,
        MEANING=MEANING,
        VERDICTS=VERDICTS,
    )
    return "\n".join(line.rstrip() for line in text.split("\n"))


def visible(text: str, lines: bool = False, limit: int = LIMIT) -> str:
    """A text as it may be shown.

    What cannot be printed (control characters, marks of direction, halves of characters) becomes
    an escape as in Python; ``lines`` keeps line feeds and tabs.  What is beyond ``limit`` is cut.
    """
    keep = "\n\t" if lines else ""
    shown = "".join(
        char if char.isprintable() or char in keep else char.encode("unicode_escape").decode()
        for char in text[:limit]
    )
    rest = len(text) - limit
    return f"{shown} … ({rest:,} characters more)" if rest > 0 else shown


def conformance(report: Report) -> tuple[bool | None, str]:
    """Whether the implementation conforms (None: cannot tell), and one sentence that says so.

    Only MUST cases decide.  An expected failure is a failure here.
    """
    must = [case for case in report.cases if case.level == "MUST"]
    found = Counter(case.verdict for case in must)
    judged = found["PASS"] + found["FAIL"]
    unclear = found["INCONC"] + found["ERROR"]
    notes = []
    verdict: bool | None
    if found["FAIL"]:
        verdict, text = False, f"Does not conform: {_count(found['FAIL'], 'MUST case')} fail"
        text += "s" if found["FAIL"] == 1 else ""
        if unclear:
            notes.append(f"{unclear} could not be judged")
    elif unclear:
        verdict, text = None, f"Cannot tell: {_count(unclear, 'MUST case')} could not be judged"
    elif not judged:
        verdict, text = None, "Cannot tell: no MUST case was run"
    else:
        verdict, text = True, f"Conforms {_roles(report)}: {judged} of {judged} MUST cases pass"
    if found["SKIP"]:
        notes.append(f"{_count(found['SKIP'], 'MUST case')} skipped")
    if report.selectors:
        notes.append("only a part of the suite was run")
    if report.problems:
        notes.append(f"{_count(len(report.problems), 'problem')} in the run")
    return verdict, "; ".join([text, *notes])


def _roles(report: Report) -> str:
    """In which roles the implementation was tested: those that it claims."""
    roles = [role for role in ("prescriber", "receiver") if role in report.implementation.features]
    return f"as {' and '.join(roles)}" if roles else "in neither role"


def group(case: CaseResult) -> str:
    """The group of rules that an id names: NEG in ``AMCM/RCV/NEG/BI-03``."""
    parts = case.id.split("/")
    return parts[-2] if len(parts) > 2 else "other"


def groups(reports: list[Report]) -> list[str]:
    """The groups that the cases are of, in the order of the specification."""
    found = {group(case) for report in reports for case in report.cases}
    return [name for name in GROUPS if name in found] + sorted(found - GROUPS.keys())


def matrix(report: Report) -> Counter[tuple[str, Verdict]]:
    """How many cases there are of each group and verdict."""
    return Counter((group(case), case.verdict) for case in report.cases)


def levels(report: Report) -> Counter[tuple[Level, Verdict]]:
    """How many cases there are of each level and verdict."""
    return Counter((case.level, case.verdict) for case in report.cases)


def totals(report: Report) -> list[tuple[str, list[int]]]:
    """What was reached of the specification, in the order in which it is shown."""
    return [(name, report.coverage[name]) for name in _ordered(set(report.coverage))]


def share(pair: list[int]) -> str:
    """[reached, total] as text with per cent, which are rounded down: 100.0 means all."""
    reached, total = pair
    part = f" ({1000 * reached // total / 10:.1f} %)" if total else ""
    return f"{reached:,} of {total:,}{part}"


def wrong(report: Report) -> dict[int, CaseResult]:
    """The cases that need a word, by their number: something went wrong, or not as expected."""
    return {
        number: case
        for number, case in enumerate(report.cases)
        if case.failures or not case.expected or case.verdict not in ("PASS", "SKIP")
    }


def _ordered(names: set[str]) -> list[str]:
    return [name for name in TOTALS if name in names] + sorted(names - set(TOTALS))


def _shown(value: object) -> object:
    """What the template prints of a value: macros of its own as they are, texts as ``visible``."""
    return visible(value, lines=True) if type(value) is str else value


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _junit(report: Report) -> JUnitXml:
    """What is not as expected is a failure or an error, as it is in the exit code.

    Cases are driven together: only the whole has a time, in seconds.
    """
    who = report.implementation
    suites: dict[str, TestSuite] = {}
    for case in report.cases:
        name = visible(case.id.rpartition("/")[0] or case.id)
        if name not in suites:
            suites[name] = TestSuite(name)
            if report.started:
                suites[name].timestamp = report.started
            suites[name].add_property("implementation", visible(f"{who.name} {who.version}"))
            suites[name].add_property("specification", visible(report.spec_hash))
        test = TestCase(visible(case.id), name.replace("/", "."))
        if result := _junit_result(case):
            test.result = result
        suites[name].add_testcase(test)
    xml = JUnitXml("AutoMCM conformance")
    for suite in suites.values():
        xml.add_testsuite(suite)
    xml.update_statistics()  # type: ignore[no-untyped-call]
    xml.time = round(report.seconds, 3)
    return xml


def _junit_result(case: CaseResult) -> Skipped | Failed | Error | None:
    """None for a case that passed."""
    if case.expected:
        return None if case.verdict == "PASS" else Skipped(why(case), case.verdict)
    result = (Error if case.verdict in ("INCONC", "ERROR") else Failed)(why(case), case.verdict)
    result.text = as_text(case)
    return result


def why(case: CaseResult) -> str:
    """Why the verdict on a case is no PASS, or not as expected: one line."""
    first = case.failures[0].what if case.failures else ""
    reason = visible(case.reason or first or case.verdict)
    if case.expected:
        known = case.verdict == case.wanted != "SKIP"
        return f"expected: {visible(case.because) or reason}" if known else reason
    if case.verdict in ("PASS", "SKIP"):
        return f"was expected to {'fail' if case.wanted == 'FAIL' else f'be {case.wanted}'}"
    return reason


def as_text(case: CaseResult) -> str:
    """What a case is about, and each of its failures with the exchange that leads to it."""
    texts = [f"given {case.given}", f"when {case.when}", f"then {case.then}"]
    texts += [f"reason: {case.reason}", f"because: {case.because}"]
    about = "\n".join(visible(text) for text in texts if not text.endswith(": "))
    return "\n\n".join([about, *(_failure_text(failure) for failure in case.failures)])


def _failure_text(failure: Failure) -> str:
    place = f" (Station.tla line {failure.line}, {failure.operator})" if failure.operator else ""
    lines = [f"{failure.rule}{place}: {failure.rule_text}", failure.what]
    lines += ["The specification allows one of", *(f"  {text}" for text in failure.allowed)]
    lines += ["What came", *(f"  {text}" for text in failure.came), "The exchange"]
    lines += [f"  {line.now:>8} ms  {line.who:<7}  {line.text}" for line in failure.exchange]
    lines += [f"Replay: {failure.command}"] if failure.command else []
    return "\n".join(visible(line) for line in lines)
