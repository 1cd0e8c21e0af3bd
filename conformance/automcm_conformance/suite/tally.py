"""The state of a run: the tours over each graph, the pairs driven, the faults found."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from automcm_conformance.exchange.exchange import Exchange, Wrong
from automcm_conformance.exchange.tours import Pair, Tours
from automcm_conformance.exchange.wire import Values
from automcm_conformance.scenarios.scenario_runner import ScenarioOutcome
from automcm_conformance.suite.purposes import Owners, Purpose
from automcm_spec.graph.oracle import Oracle

WHOLE = "the whole suite, not --quick"
"""What a pair or a case that ``--quick`` omits needs."""
ENOUGH = 3
"""The number of wrong answers after which a case is decided and driven no further."""


@dataclass(slots=True)
class PairPart:
    """Some pairs of one graph, and the tours over them."""

    name: str
    oracle: Oracle
    third: bool = False
    totals: Counter[str] = field(default_factory=Counter)
    """``transitions`` and ``refusals``."""
    reached: Counter[str] = field(default_factory=Counter)
    forbidden: int = 0
    """Pairs that time does not allow with the parameters (without ``durations``)."""
    owners: Owners = field(init=False)
    tours: Tours = field(init=False)
    planned: int = 0
    started: int = 0
    unsent: list[TourInProgress] = field(default_factory=list)
    """Tours whose lines are not sent yet."""
    sent: list[TourInProgress] = field(default_factory=list)
    """Tours whose lines the station is answering."""
    attempts: Counter[Pair] = field(default_factory=Counter)


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
    faults: list[Wrong] = field(default_factory=list)
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
        o = self.outcome
        return bool(self.faults) or (o is not None and o.verdict in ("FAIL", "ERROR"))


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
