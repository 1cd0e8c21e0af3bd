"""The results of a run of the suite: verdicts, failures, coverage. Plain data, JSON and back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator
from pydantic_core import PydanticCustomError

Verdict = Literal["PASS", "FAIL", "INCONC", "SKIP", "ERROR"]
"""INCONC: the steps before the test failed. ERROR: the kit or the adapter broke."""
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
KEPT = "state kept over reset"
NONDETERMINISTIC = "nondeterministic"
UNCONFIRMED = {
    KEPT: "a fresh process answers the same lines correctly, a used one does not",
    NONDETERMINISTIC: "answered differently when the same was sent again",
}
"""The differences of failures that a fresh process does not show, in words: other verdicts are
doubtful."""
CUT_SHORT = "cut short"
"""The beginning of a problem or note about a run that did not drive all."""
INTERRUPTED = "interrupted"
BROKE = "the kit broke"
"""The beginning of a problem that is a fault of the kit."""
EARLY = CUT_SHORT, INTERRUPTED, BROKE
"""The beginnings of what is said of a run that ended early."""
Level = Literal["MUST", "SHOULD", "MAY"]
LEVELS: tuple[Level, ...] = get_args(Level)


def _share(pair: list[int]) -> list[int]:
    if len(pair) != 2 or not 0 <= pair[0] <= pair[1]:
        raise PydanticCustomError("share", "must be [reached, total]")
    return pair


Share = Annotated[list[int], AfterValidator(_share)]
"""[reached, total]"""


@dataclass(slots=True)
class Deciding:
    """What decides a wrong answer. Texts are empty if unknown."""

    rule: str = ""
    operator: str = ""
    """The operator of Station.tla; empty if it is not about one of its rules."""
    line: int = 0
    """The line of Station.tla that names the rule."""
    guard: str = ""
    """The guards that were evaluated last, with the values in them."""
    as_if: str = ""
    """The guards that would have to be different to require the messages, the indication and the
    phase of the answer."""


@dataclass(slots=True)
class Line:
    """One line of an exchange: the sender, the time (virtual ms), and the content in words."""

    now: int
    who: Literal["kit", "station"]
    text: str


@dataclass(slots=True, kw_only=True)
class Failure(Deciding):
    """One wrong answer, with the shortest exchange that leads to it."""

    rule_text: str
    what: str
    """The difference, in one line."""
    allowed: list[str]
    """The answers that the specification allows at that point."""
    came: list[str]
    exchange: list[Line]
    replay: str = ""
    """File for ``automcm conform replay``, relative to the report."""
    command: str = ""
    """The command that replays this exchange."""
    timer: str = ""
    """The timer whose deadline was expected."""
    difference: str = ""
    """What differs, without values."""


@dataclass(slots=True)
class CaseResult:
    """The verdict on one case."""

    id: str
    verdict: Verdict
    rules: list[str]
    level: Level
    given: str
    when: str
    then: str
    bug: str
    cost: str
    reason: str = ""
    """The reason why it is not PASS, or the parts left out, in one line."""
    wanted: Verdict = "PASS"
    """The verdict in the expectations file; ``because`` is its comment."""
    because: str = ""
    reached: int = 0
    total: int = 0
    """The number of pairs of state and input driven, of ``total`` that belong to the case."""
    failures: list[Failure] = field(default_factory=list)
    log: str = ""
    """The log of one exchange of this case, relative to the report."""
    page: str = ""
    """The log as a page, if the verdict is not PASS."""

    @property
    def expected(self) -> bool:
        """Only unexpected verdicts count. A skipped case never counts."""
        return self.verdict == self.wanted or (self.verdict == "SKIP" and self.wanted == "PASS")


Cause = list[tuple[CaseResult, Failure]]
"""Failures with equal difference that one operator decided, and their cases: probably one bug. The
first has the shortest exchange.

The difference in one field, such as ``Ack.of.seq``, is one cause whatever decided.
"""


def causes(cases: Iterable[CaseResult]) -> list[Cause]:
    """The causes of the failures of these cases, the likeliest one first.

    What makes other verdicts doubtful comes first, then FAIL, then ERROR; failures of one station
    come before those of a scenario, and the shortest exchange comes first.
    """
    groups: dict[tuple[str, ...], Cause] = {}
    for case in cases:
        for failure in case.failures:
            groups.setdefault(_cause(case, failure), []).append((case, failure))
    for group in groups.values():
        first = group.index(min(group, key=lambda one: _order(*one)))
        group.insert(0, group.pop(first))
    return sorted(groups.values(), key=lambda found: (*_rank(*found[0]), -len(found)))


def _as_dict(cause: Cause) -> dict[str, object]:
    """For JSON: the failure is named by its replay and described in its case."""
    case, shown = cause[0]
    names = "rule", "operator", "line", "what", "guard", "timer", "difference", "replay"
    about = {name: getattr(shown, name) for name in names}
    counted = {"failures": len(cause), "cases": ids_of(cause)}
    return {"verdict": case.verdict, "case": case.id, **about, **counted}


def ids_of(cause: Cause) -> list[str]:
    """The ids of the cases that show a cause."""
    return list(dict.fromkeys(case.id for case, _ in cause))


def _cause(case: CaseResult, failure: Failure) -> tuple[str, ...]:
    about = failure.difference or failure.what
    field = "." in about and " " not in about
    return (case.verdict, about) if field else (case.verdict, about, failure.operator, failure.rule)


def _order(case: CaseResult, failure: Failure) -> tuple[bool, int, str, str]:
    return _in_scenario(case.id), len(failure.exchange), case.id, failure.replay


def _rank(case: CaseResult, shown: Failure) -> tuple[int, bool, int]:
    kind = 0 if shown.difference in UNCONFIRMED else 1 if case.verdict == "FAIL" else 2
    return kind, _in_scenario(case.id), len(shown.exchange)


def _in_scenario(case: str) -> bool:
    """The second part of an id is the role that is tested; of several stations, the system."""
    return case.split("/")[1] == "SYS"


@dataclass(slots=True)
class Implementation:
    """The implementation's answer to ``hello``, and its command."""

    name: str
    version: str
    issues: str
    features: list[str]
    scenarios: list[str]
    fixed: dict[str, int]
    command: list[str]


@dataclass(slots=True)
class Report:
    """A run. Two equal runs differ only in ``seconds``, ``case_seconds`` and ``started``."""

    implementation: Implementation
    cases: list[CaseResult]
    coverage: dict[str, Share]
    """``transitions``, ``refusals``, ``rules``."""
    graphs: dict[str, dict[str, Share]]
    """The same for each graph: transitions, refusals, and pairs that time does not allow."""
    spec_hash: str
    seed: int
    selectors: list[str]
    problems: list[str] = field(default_factory=list)
    """Problems that are not about one case: a process that ignored ``stop``, an interrupted run."""
    started: str = ""
    seconds: float = 0.0
    notes: list[str] = field(default_factory=list)
    """Remarks on the run that affect no verdict, such as that the adapter is slow."""
    case_seconds: dict[str, float] = field(default_factory=dict)
    """The time of each case; the cases of a graph share that of their tours."""
    broke: bool = False
    """The run was cut short by a fault of automcm."""

    @property
    def counts(self) -> dict[str, int]:
        """The number of cases of each verdict."""
        found = Counter(case.verdict for case in self.cases)
        return {verdict: found[verdict] for verdict in VERDICTS}

    @property
    def unexpected(self) -> list[CaseResult]:
        """The cases whose verdict is not the expected one."""
        return [case for case in self.cases if not case.expected]

    @property
    def causes(self) -> list[Cause]:
        """The causes of all failures, the likeliest one first."""
        return causes(self.cases)

    @property
    def exit_code(self) -> int:
        """0: as expected; 70: the kit broke; 1: an unexpected FAIL, or an expected deviation that
        did not occur; else 3: an ERROR; else 130: interrupted; else 4: only INCONC."""
        if self.broke:
            return 70
        verdicts = {case.verdict for case in self.unexpected}
        if verdicts & {"FAIL", "PASS", "SKIP"}:
            return 1
        if "ERROR" in verdicts:
            return 3
        if INTERRUPTED in self.notes:
            return 130
        return 4 if verdicts else 0

    def as_dict(self) -> dict[str, object]:
        """For ``report.json``."""
        out = asdict(self)
        out.pop("broke")
        for case, result in zip(out["cases"], self.cases, strict=True):
            case["expected"] = result.expected
        return {
            "format": FORMAT,
            "implementation": out.pop("implementation"),
            "counts": self.counts,
            "exit_code": self.exit_code,
            "causes": [_as_dict(cause) for cause in self.causes],
            **out,
        }


FORMAT = "automcm.report/1"
EXPLORED = "automcm.exploration/1"


@dataclass(slots=True)
class Exploration:
    """The results of an exploration. ``seconds`` and ``started`` are times; ``walks``, ``lines``
    and ``coverage`` depend on them, unless the number of walks was given."""

    implementation: Implementation
    seed: int
    spec_hash: str
    cases: list[CaseResult] = field(default_factory=list)
    acts: dict[str, int] = field(default_factory=dict)
    """The number of acts in the shortened walk of a case."""
    again: int = 0
    """The number of walks that failed in the same way as an earlier one."""
    problems: list[str] = field(default_factory=list)
    walks: int = 0
    lines: int = 0
    coverage: dict[str, dict[str, list[int]]] = field(default_factory=dict)
    started: str = ""
    seconds: float = 0.0
    broke: bool = False
    """The exploration was cut short by a fault of automcm."""

    @property
    def exit_code(self) -> int:
        """0: nothing is wrong; 70: the kit broke; 1: a rule is broken; 3: an ERROR, or another
        problem than the interruption, which is 130."""
        if self.broke:
            return 70
        verdicts = {case.verdict for case in self.cases}
        if verdicts or set(self.problems) - {INTERRUPTED}:
            return 1 if "FAIL" in verdicts else 3
        return 130 if self.problems else 0

    def as_dict(self) -> dict[str, object]:
        """For ``exploration.json``."""
        out = asdict(self)
        out.pop("broke")
        return {"format": EXPLORED, "exit_code": self.exit_code, **out}
