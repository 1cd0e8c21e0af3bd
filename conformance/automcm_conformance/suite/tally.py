"""The state of a run: the tours over each graph, the pairs driven, the faults found."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from automcm_conformance.exchange.deciding import Deciding
from automcm_conformance.exchange.exchange import Broken, Exchange, Mismatch
from automcm_conformance.exchange.play import Wrong
from automcm_conformance.exchange.results import KEPT, NONDETERMINISTIC, Verdict
from automcm_conformance.exchange.tours import Pair, Tours
from automcm_conformance.exchange.wire import Values
from automcm_conformance.scenarios.scenario_runner import ScenarioOutcome
from automcm_conformance.suite.purposes import Owners, Purpose
from automcm_spec.graph.oracle import Oracle
from automcm_traces.checker.finding import Finding, Kind

UNCONFIRMED_TEXTS = {
    KEPT: "a fresh process answers the same lines correctly, a used one does not",
    NONDETERMINISTIC: "answered differently when the same was sent again",
}
WHOLE = "the whole suite, not --quick"
"""What a pair or a case that ``--quick`` omits needs."""
ENOUGH = 3
"""The number of wrong answers after which a case is decided and driven no further."""


@dataclass(slots=True)
class PairPart:
    """Some pairs of one graph."""

    name: str
    oracle: Oracle
    third: bool = False
    totals: Counter[str] = field(default_factory=Counter)
    """``transitions`` and ``refusals``."""
    reached: Counter[str] = field(default_factory=Counter)
    forbidden: int = 0
    """Pairs that time does not allow with the parameters (without ``durations``)."""
    tours: Tours | None = None


@dataclass(frozen=True, slots=True)
class Fault:
    """A finding, and the exchange that shows it: its last answer is wrong, or missing."""

    finding: Finding
    error: Wrong
    deciding: Deciding

    unconfirmed: str = ""
    """Why a fresh process does not fail: one of UNCONFIRMED; empty if it does."""

    @property
    def difference(self) -> str:
        """What differs, without values."""
        if self.unconfirmed or not isinstance(self.error, Mismatch):
            return self.unconfirmed or (self.error.kind if isinstance(self.error, Broken) else "")
        return self.error.problems[0].kind

    @property
    def verdict(self) -> Verdict:
        """ERROR if the adapter broke, or did not answer twice in the same way."""
        return "ERROR" if self.finding.kind in ("unreadable", "cannot_tell") else "FAIL"


def finding(error: Wrong, rule: str, more: str = "", *, unconfirmed: str = "") -> Finding:
    """The finding of a wrong exchange, with the text ``more``. ``unconfirmed``: the same lines got
    another answer when they were sent again, as one of UNCONFIRMED says."""
    if unconfirmed:
        why = f"{unconfirmed}: {UNCONFIRMED_TEXTS[unconfirmed]}"
        return Finding("cannot_tell", rule, observed=f"{why}: {error}{more}")
    kind: Kind = "unreadable"
    if isinstance(error, Mismatch):
        kind = "state" if error.parts == {"phase"} else "unexpected"
    return Finding(kind, rule, observed=f"{error}{more}")


@dataclass(slots=True)
class Tally:
    """The state of one case."""

    purpose: Purpose
    total: int = 0
    reached: int = 0
    forbidden: int = 0
    hits: int = 0
    """Wrong answers at its pairs, whichever case is to blame."""
    skipped: Counter[str] = field(default_factory=Counter)
    """The numbers of omitted pairs, by reason."""
    faults: list[Fault] = field(default_factory=list)
    sample: tuple[PairPart, Pair] | None = None
    """A pair that was driven."""
    log: str = ""
    outcome: ScenarioOutcome | None = None
    """The outcome of a scenario."""

    @property
    def decided(self) -> bool:
        """Whether further driving adds nothing to the verdict."""
        return len(self.faults) >= ENOUGH or self.hits > 2 * ENOUGH

    @property
    def failed(self) -> bool:
        """Whether the case is FAIL or ERROR."""
        bad = self.outcome is not None and self.outcome.verdict in ("FAIL", "ERROR")
        return bad or bool(self.faults)


@dataclass(slots=True)
class TourInProgress:
    """A tour that is being played."""

    x: Exchange
    tour: list[int]
    lease: int
    values: Values
    soonest: str
    off: Pair | None = None
    """The pair that time does not allow; the tour ends there."""


@dataclass(slots=True)
class PartRun:
    """The tours over one part, in a run."""

    part: PairPart
    owners: Owners
    tours: Tours
    planned: int
    started: int = 0
    unsent: list[TourInProgress] = field(default_factory=list)
    """Tours whose lines are not sent yet."""
    sent: list[TourInProgress] = field(default_factory=list)
    """Tours whose lines the station is answering."""
    attempts: Counter[Pair] = field(default_factory=Counter)

    @property
    def lines(self) -> int:
        """The number of lines that are not sent yet."""
        return sum(len(active.x.unwritten_steps) for active in self.unsent)
