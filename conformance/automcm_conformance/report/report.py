"""The files of a run: report.json for programs, junit.xml for CI, report.html for readers.

Much of a report is text of a program under test.  All text that is shown goes through ``visible``.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from difflib import SequenceMatcher
from pathlib import Path

from junitparser import Error, JUnitXml, Skipped, TestCase, TestSuite
from junitparser import Failure as Failed
from pydantic import TypeAdapter, ValidationError

from automcm_conformance.exchange.results import (
    FORMAT,
    LEVELS,
    VERDICTS,
    CaseResult,
    Cause,
    Failure,
    Level,
    Report,
    Verdict,
    ids_of,
)
from automcm_spec.support import files
from automcm_spec.support.bad_input import BadInput, SpooledInput, errors_of, printable
from automcm_spec.support.templates import environment
from automcm_spec.vocabulary.rules import RULES, operators
from automcm_traces.checker.finding import Finding, Where
from automcm_traces.viewer import page as page_
from automcm_traces.viewer.page_data import load as load_logs
from automcm_traces.viewer.page_part import PageError
from automcm_traces.viewer.page_run import PageRun

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
    "PASS": "The specification allows every answer.",
    "FAIL": "The specification does not allow an answer, or a required answer is missing.",
    "INCONC": "Inconclusive: the preparation of the test failed, so the test proves nothing.",
    "SKIP": "Not run, because the implementation does not claim the tested feature. Has no effect "
    "on conformance.",
    "ERROR": "The kit or the adapter failed: its process exited, or an answer was late or invalid.",
}
TOTALS = ("transitions", "refusals", "rules")
NAMED = 5
"""A cause names at most this many other cases."""
MAX_PAGES = 20
"""A run has at most this many pages; further cases have logs only."""
LIMIT = 4000
"""At most this many characters of a text are shown; report.json has all."""
Parts = list[tuple[str, bool]]
_REPORT = TypeAdapter(Report)


def write(report: Report, folder: Path) -> list[Path]:
    """Write report.json, junit.xml and report.html to the folder, which is created if needed.

    Equal reports give equal bytes, apart from ``started`` and ``seconds``.  Raises OSError if a
    file cannot be written.
    """
    files.folder(folder, named=True)
    paths = [folder / name for name in ("report.json", "junit.xml", "report.html")]
    text = json.dumps(report.as_dict(), indent=2, sort_keys=True) + "\n"
    files.write(paths[0], text)
    with files.writing(paths[1]) as junit:
        _junit(report).write(junit, pretty=True)
    files.write(paths[2], html([report]))
    return paths


def write_pages(report: Report, folder: Path) -> None:
    """Write a page beside the log of each case that did not pass, and name it in the report.

    Raises OSError if it cannot be written.
    """
    shown = [c for c in report.cases if c.log and c.verdict not in ("PASS", "SKIP")]
    for case in shown[:MAX_PAGES]:
        log = folder / case.log
        several = log.parent != folder / "logs"
        paths = sorted(log.parent.glob("*.ndjson")) if several else [log]
        logs = [SpooledInput(path) for path in paths]
        for path in logs:
            path.given = path.relative_to(folder).as_posix()
        try:
            page = load_logs(logs, f"{case.id}: {case.verdict}")
        except (BadInput, PageError):
            continue  # the log itself is kept
        if not several and page.runs[0].verdicts[0].verdict == "allowed":
            _judge_by_kit(page.runs[0], case)
            page.note = "The verdict is that of the kit: the log does not show what is wrong."
        written = log.with_suffix(".html")
        files.write(written, page_.html(page))
        case.page = written.relative_to(folder).as_posix()


def _judge_by_kit(run: PageRun, case: CaseResult) -> None:
    """Set the verdict of the kit at the last input of a log, where the page then opens."""
    (log,), verdict = run.logs, run.verdicts[0]
    inputs = (line for line, event in log.events if event.is_input)
    line = max(inputs, default=verdict.finding.at.line)
    shown = case.failures[0] if case.failures else None
    found = Finding(
        "unexpected",
        shown.rule if shown else case.rules[0],
        at=Where(verdict.file, line),
        expected=tuple(shown.allowed) if shown else (),
        observed=f"{case.verdict}: {shown.what if shown else case.reason}",
        guard=shown.guard if shown else "",
    )
    run.verdicts[0] = replace(verdict, finding=found)


def load(path: Path) -> Report:
    """The report in a report.json.

    Raises ValueError with file and field if it is invalid, and OSError if it cannot be read.
    """
    try:
        value = json.loads(path.read_text("utf-8"))
        if not isinstance(value, dict) or value.get("format") != FORMAT:
            raise ValueError(f"format: expected {FORMAT}; give the report.json of a run")
        return _REPORT.validate_python(value)
    except ValidationError as error:
        raise ValueError(visible(f"{path}: {': '.join(errors_of(error)[0])}")) from None
    except (ValueError, RecursionError) as error:
        raise ValueError(visible(f"{path}: {error}")) from None


def failed_last(reports: Iterable[Path], command: Sequence[str]) -> list[str] | None:
    """The ids of the cases that are FAIL or ERROR in the newest of these reports on an adapter's
    command; None if there is none. Raises ValueError and OSError as ``load``."""
    for path in sorted(reports, key=lambda path: path.stat().st_mtime, reverse=True):
        report = load(path)
        if report.implementation.command == list(command):
            return [case.id for case in report.cases if case.verdict in ("FAIL", "ERROR")]
    return None


def html(reports: list[Report]) -> str:
    """One self-contained page for one run, or for several side by side."""
    templates = environment(Path(__file__).parent, autoescape=True, finalize=_shown)
    page = templates.get_template("report.html.j2")
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
        about=about,
        compared=compared,
        divided=divided,
        rules=_cited(reports),
        sources=(sources := _sources(reports)),
        placed={number for lines in sources.values() for number, _ in lines},
        seen_in=seen_in,
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


def compared(failure: Failure) -> tuple[list[Parts], list[Parts]]:
    """The allowed and the received answers as parts: a text, and whether it differs.

    What was received is compared with the allowed answer that is most like it.
    """
    came = "\n".join(failure.came)
    near = max(failure.allowed, key=lambda one: _matcher(one, came).ratio(), default="")
    allowed = [
        _parts(one, came, 0) if one == near and came else [(one, False)] for one in failure.allowed
    ]
    return allowed, [_parts(near, one, 1) if near else [(one, False)] for one in failure.came]


def _words(text: str) -> list[str]:
    return re.findall(r"\s+|[\w.-]+|\W", text)


def _matcher(a: str, b: str) -> SequenceMatcher[str]:
    return SequenceMatcher(None, _words(a), _words(b), autojunk=False)


def _parts(a: str, b: str, side: int) -> Parts:
    """The words of one of two texts, and whether the other has them."""
    words = _words((a, b)[side])
    return [
        ("".join(words[i:j]), tag != "equal")
        for tag, *at in _matcher(a, b).get_opcodes()
        for i, j in [at[2 * side : 2 * side + 2]]
        if i < j
    ]


def divided(
    reports: list[Report], cases: list[CaseResult]
) -> tuple[list[CaseResult], list[CaseResult]]:
    """The cases to look at, and those that passed or were skipped in each run."""
    loud = {report.cases[n].id for report in reports for n in wrong(report)}
    return [case for case in cases if case.id in loud], [c for c in cases if c.id not in loud]


def _failures_of(reports: list[Report]) -> list[Failure]:
    return [failure for r in reports for case in r.cases for failure in case.failures]


def _cited(reports: list[Report]) -> dict[str, str]:
    """The rules of the cases that did not pass, with their texts."""
    ids = {failure.rule for failure in _failures_of(reports)}
    ids |= {rule for r in reports for n in wrong(r) for rule in r.cases[n].rules}
    return {rule: RULES[rule] for rule in sorted(ids & RULES.keys())}


def _sources(reports: list[Report]) -> dict[str, list[tuple[int, str]]]:
    """The operators of Station.tla that failures name, as numbered lines."""
    known = operators()
    names = sorted({failure.operator for failure in _failures_of(reports)} & known.keys())
    return {
        name: list(enumerate(known[name][1].rstrip().split("\n"), known[name][0])) for name in names
    }


def visible(text: str, lines: bool = False, limit: int = LIMIT) -> str:
    """A text that is safe to show.

    Characters are escaped by ``printable``; ``lines`` keeps line feeds and tabs.  Text beyond
    ``limit`` characters is cut.
    """
    shown = printable(text[:limit], "\n\t" if lines else "")
    rest = len(text) - limit
    return f"{shown} … ({rest:,} characters more)" if rest > 0 else shown


def conformance(report: Report) -> tuple[bool | None, str]:
    """Whether the implementation conforms (None: cannot tell), and a sentence for the report.

    Only MUST cases decide.  An expected failure counts as a failure.
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
        features = report.implementation.features
        roles = [role for role in ("prescriber", "receiver") if role in features]
        as_ = f"as {' and '.join(roles)}" if roles else "in neither role"
        verdict, text = True, f"Conforms {as_}: {judged} of {judged} MUST cases pass"
    if found["SKIP"]:
        notes.append(f"{_count(found['SKIP'], 'MUST case')} skipped")
    if report.selectors:
        notes.append("only a part of the suite was run")
    if report.problems:
        notes.append(f"{_count(len(report.problems), 'problem')} in the run")
    return verdict, "; ".join([text, *notes])


def group(case: CaseResult) -> str:
    """The group of rules that an id names: NEG in ``AMCM/RCV/NEG/BI-03``."""
    parts = case.id.split("/")
    return parts[-2] if len(parts) > 2 else "other"


def groups(reports: list[Report]) -> list[str]:
    """The groups of the cases, in the order of the specification."""
    found = {group(case) for report in reports for case in report.cases}
    return [name for name in GROUPS if name in found] + sorted(found - GROUPS.keys())


def matrix(report: Report) -> Counter[tuple[str, Verdict]]:
    """The number of cases of each group and verdict."""
    return Counter((group(case), case.verdict) for case in report.cases)


def levels(report: Report) -> Counter[tuple[Level, Verdict]]:
    """The number of cases of each level and verdict."""
    return Counter((case.level, case.verdict) for case in report.cases)


def totals(report: Report) -> list[tuple[str, list[int]]]:
    """The coverage of the specification, in the order in which it is shown."""
    return [(name, report.coverage[name]) for name in _ordered(set(report.coverage))]


def share(pair: list[int]) -> str:
    """[reached, total] as text with a percentage, rounded down so that 100.0 means all."""
    reached, total = pair
    part = f" ({1000 * reached // total / 10:.1f} %)" if total else ""
    return f"{reached:,} of {total:,}{part}"


def wrong(report: Report) -> dict[int, CaseResult]:
    """The cases to explain, by their number: those with a failure or an unexpected verdict."""
    return {
        number: case
        for number, case in enumerate(report.cases)
        if case.failures or not case.expected or case.verdict not in ("PASS", "SKIP")
    }


def _ordered(names: set[str]) -> list[str]:
    return [name for name in TOTALS if name in names] + sorted(names - set(TOTALS))


def _shown(value: object) -> object:
    """A value as the template prints it: strings through ``visible``, its own macros unchanged."""
    return visible(value, lines=True) if type(value) is str else value


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _junit(report: Report) -> JUnitXml:
    """The report as JUnit XML, in which only unexpected verdicts are failures or errors.

    A case that was not reached (INCONC) is skipped.  The cases of a graph are run together; the
    time of each, in seconds, is its share.
    """
    who, found = report.implementation, report.causes
    named: dict[str, str] = {}
    for n, cause in enumerate(found, 1):
        for case, _ in cause:
            named.setdefault(case.id, f"cause {n} of {len(found)}, {cause[0][1].rule}")
    suites: dict[str, TestSuite] = {}
    for case in report.cases:
        name = visible(case.id.rpartition("/")[0] or case.id)
        if name not in suites:
            suites[name] = TestSuite(name)
            if report.started:
                suites[name].timestamp = report.started
            suites[name].add_property("implementation", visible(f"{who.name} {who.version}"))
            suites[name].add_property("specification", visible(report.spec_hash))
        time = report.case_seconds.get(case.id)
        test = TestCase(visible(case.id), name.replace("/", "."), time)
        if result := _junit_result(case, named.get(case.id, "")):
            test.result = result
        suites[name].add_testcase(test)
    xml = JUnitXml("AutoMCM conformance")
    for suite in suites.values():
        xml.add_testsuite(suite)
    xml.update_statistics()  # type: ignore[no-untyped-call]
    xml.time = round(report.seconds, 3)
    return xml


def _junit_result(case: CaseResult, cause: str) -> Skipped | Failed | Error | None:
    """The result of a case; None if it passed. ``cause`` is the cause that it shows."""
    if case.expected:
        return None if case.verdict == "PASS" else Skipped(why(case), case.verdict)
    if case.verdict == "INCONC":
        return Skipped(why(case), case.verdict)
    text = f"{cause}: {why(case)}" if cause else why(case)
    result = (Error if case.verdict == "ERROR" else Failed)(text, case.verdict)
    result.text = as_text(case)
    return result


def why(case: CaseResult) -> str:
    """One line: why the verdict on a case is not PASS, or is unexpected."""
    reason = case.reason or (case.failures[0].what if case.failures else "")
    if case.expected and case.verdict == case.wanted != "SKIP":
        reason = f"expected: {case.because or reason or case.verdict}"
    elif case.wanted not in ("PASS", case.verdict):
        reason = "; ".join(filter(None, (f"{case.wanted} was expected", reason)))
    return visible(reason or case.verdict)


def as_text(case: CaseResult) -> str:
    """The purpose of a case, and each of its failures with the exchange that leads to it."""
    texts = [f"given {case.given}", f"when {case.when}", f"then {case.then}"]
    texts += [f"reason: {case.reason}", f"because: {case.because}"]
    about = "\n".join(visible(text) for text in texts if not text.endswith(": "))
    return "\n\n".join([about, *(_failure_text(failure) for failure in case.failures)])


def about(failure: Failure) -> list[str]:
    """What is wrong, in lines: the rule, the difference, the place and guard that decided."""
    lines = [f"{failure.rule}: {failure.rule_text}"] if failure.rule else []
    lines.append(failure.what)
    if failure.operator:
        guard = f": {failure.guard}" if failure.guard else ""
        lines.append(f"Station.tla, line {failure.line}: {failure.operator}{guard}")
    elif failure.guard:
        lines.append(failure.guard)
    lines += [f"The station answers as if {failure.as_if}"] if failure.as_if else []
    return lines + ([f"Timer of the expected deadline: {failure.timer}"] if failure.timer else [])


def seen_in(cause: Cause) -> str:
    """How often a cause was seen, and in which cases."""
    _, *others = ids_of(cause)
    if not others:
        return f"Seen {_count(len(cause), 'time')}, in this case only"
    more = f" and {len(others) - NAMED} more" if len(others) > NAMED else ""
    shown = ", ".join(others[:NAMED])
    return f"Seen {_count(len(cause), 'time')}, also in {shown}{more}"


def _failure_text(failure: Failure) -> str:
    lines = about(failure)
    lines += ["Expected one of", *(f"  {text}" for text in failure.allowed)]
    lines += ["Received", *(f"  {text}" for text in failure.came), "Exchange"]
    lines += [f"  {line.now:>8} ms  {line.who:<7}  {line.text}" for line in failure.exchange]
    lines += [f"Replay: {failure.command}"] if failure.command else []
    return "\n".join(visible(line) for line in lines)
