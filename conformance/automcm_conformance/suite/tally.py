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
    """A wrong exchange: its last answer is wrong, or missing."""

    error: Wrong
    deciding: Deciding
    more: str = ""
    """Text that follows that of the error."""
    unconfirmed: str = ""
    """Why a fresh process does not fail: one of UNCONFIRMED; empty if it does."""

    @property
    def rule(self) -> str:
        """The rule that decides; empty if none is known."""
        return self.deciding.rule

    @property
    def what(self) -> str:
        """What is wrong, in one line."""
        why = self.unconfirmed
        return f"{f'{why}: {UNCONFIRMED_TEXTS[why]}: ' if why else ''}{self.error}{self.more}"

    @property
    def difference(self) -> str:
        """What differs, without values."""
        if self.unconfirmed or not isinstance(self.error, Mismatch):
            return self.unconfirmed or (self.error.kind if isinstance(self.error, Broken) else "")
        return self.error.problems[0].kind

    @property
    def verdict(self) -> Verdict:
        """ERROR if the adapter broke, or did not answer twice in the same way."""
        return "FAIL" if isinstance(self.error, Mismatch) and not self.unconfirmed else "ERROR"


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
