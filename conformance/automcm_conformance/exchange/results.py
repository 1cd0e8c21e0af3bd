"""What a run of the suite says: verdicts, failures, coverage.  Plain data, JSON and back."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator
from pydantic_core import PydanticCustomError

Verdict = Literal["PASS", "FAIL", "INCONC", "SKIP", "ERROR"]
"""INCONC: what leads to the test went wrong.  ERROR: the kit or the adapter broke."""
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
BROKE = "the kit broke"
"""How a problem begins that is a fault of the kit."""
Level = Literal["MUST", "SHOULD", "MAY"]


def _share(pair: list[int]) -> list[int]:
    if len(pair) != 2 or not 0 <= pair[0] <= pair[1]:
        raise PydanticCustomError("share", "[reached, total] is needed")
    return pair


Share = Annotated[list[int], AfterValidator(_share)]
"""[reached, total]"""


@dataclass(slots=True)
class Line:
    """One line of an exchange: who said it, when (virtual ms), and what, in words."""

    now: int
    who: Literal["kit", "station"]
    text: str


@dataclass(slots=True)
class Failure:
    """One wrong answer, with the shortest exchange that leads to it."""

    rule: str
    rule_text: str
    operator: str
    """Of Station.tla; empty where the failure is not about a rule of it."""
    line: int
    what: str
    """What is wrong, in one line."""
    allowed: list[str]
    """What the specification allows at that point: one of these."""
    came: list[str]
    exchange: list[Line]
    replay: str = ""
    """File for ``automcm conform replay``, relative to the report."""
    command: str = ""
    """The command that replays exactly this."""


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
    """Why it is not PASS, or what was left out, in one line."""
    wanted: Verdict = "PASS"
    """What the expectations file says; ``because`` is its comment."""
    because: str = ""
    reached: int = 0
    total: int = 0
    """Pairs of state and input driven, of those that belong to the case."""
    failures: list[Failure] = field(default_factory=list)
    log: str = ""
    """Log of one exchange of this case, relative to the report."""
    page: str = ""
    """The same as a page; only of a case that is no PASS."""

    @property
    def expected(self) -> bool:
        """Only what is not expected counts.  What is skipped counts neither way."""
        return self.verdict == self.wanted or (self.verdict == "SKIP" and self.wanted == "PASS")


@dataclass(slots=True)
class Implementation:
    """What ``hello`` told, and how it was started."""

    name: str
    version: str
    issues: str
    features: list[str]
    scenarios: list[str]
    fixed: dict[str, int]
    command: list[str]


@dataclass(slots=True)
class Report:
    """A run.  ``seconds`` and ``started`` are the only things two equal runs differ in."""

    implementation: Implementation
    cases: list[CaseResult]
    coverage: dict[str, Share]
    """``transitions``, ``refusals``, ``rules``."""
    graphs: dict[str, dict[str, Share]]
    """The same for each graph: transitions, refusals and what time forbids."""
    spec_hash: str
    seed: int
    selectors: list[str]
    problems: list[str] = field(default_factory=list)
    """What is not about one case: a process that ignored ``stop``, a run that was cut short."""
    started: str = ""
    seconds: float = 0.0
    broke: bool = False
    """The run was cut short by a fault of ours."""

    @property
    def counts(self) -> dict[str, int]:
        """How many cases of each verdict."""
        found = Counter(case.verdict for case in self.cases)
        return {verdict: found[verdict] for verdict in VERDICTS}

    @property
    def unexpected(self) -> list[CaseResult]:
        """Cases that did not end as expected."""
        return [case for case in self.cases if not case.expected]

    @property
    def exit_code(self) -> int:
        """0 as expected; 70 if the kit broke; 1 if a FAIL, or an expected deviation that did not
        come, is unexpected; else 3 if an ERROR is; else 4: only INCONC."""
        if self.broke:
            return 70
        verdicts = {case.verdict for case in self.unexpected}
        if verdicts & {"FAIL", "PASS", "SKIP"}:
            return 1
        if "ERROR" in verdicts:
            return 3
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
            **out,
        }


FORMAT = "automcm.report/1"
EXPLORED = "automcm.exploration/1"


@dataclass(slots=True)
class Exploration:
    """What was found.  ``seconds`` and ``started`` are times; ``walks``, ``lines`` and
    ``coverage`` follow from them, unless the number of walks was given."""

    implementation: Implementation
    seed: int
    spec_hash: str
    cases: list[CaseResult] = field(default_factory=list)
    acts: dict[str, int] = field(default_factory=dict)
    """How many acts the shortened walk of a case has."""
    again: int = 0
    """Walks that went wrong as one did before."""
    problems: list[str] = field(default_factory=list)
    walks: int = 0
    lines: int = 0
    coverage: dict[str, dict[str, list[int]]] = field(default_factory=dict)
    started: str = ""
    seconds: float = 0.0
    broke: bool = False
    """It was cut short by a fault of ours."""

    @property
    def exit_code(self) -> int:
        """0 if nothing is wrong; 70 if the kit broke; 1 if a rule is broken; else 3."""
        if self.broke:
            return 70
        verdicts = {case.verdict for case in self.cases}
        return 1 if "FAIL" in verdicts else 3 if verdicts or self.problems else 0

    def as_dict(self) -> dict[str, object]:
        """For ``exploration.json``."""
        out = asdict(self)
        out.pop("broke")
        return {"format": EXPLORED, "exit_code": self.exit_code, **out}
