"""What a run finds out: which pairs of which graph were driven, and what was wrong."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from automcm_conformance.exchange import Step
from automcm_conformance.purposes import Purpose
from automcm_conformance.results import Verdict
from automcm_conformance.stage import Outcome
from automcm_conformance.tour import Pair, Tours
from automcm_spec.oracle import Oracle
from automcm_spec.station import Input

ENOUGH = 3
"""Wrong answers after which a case is decided, and driven no further."""


@dataclass(slots=True)
class Part:
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


@dataclass(slots=True)
class Fault:
    """An exchange whose last answer is wrong, or does not come."""

    verdict: Verdict
    steps: list[Step]
    rule: str
    input: Input | None
    """The input that the rule decides."""
    what: str
    stderr: list[str] = field(default_factory=list)
    """What the process said last, if it is gone."""


@dataclass(slots=True)
class Tally:
    """What is known of one case."""

    purpose: Purpose
    total: int = 0
    reached: int = 0
    forbidden: int = 0
    hits: int = 0
    """Wrong answers at its pairs, whatever was to blame."""
    skipped: Counter[str] = field(default_factory=Counter)
    """Why pairs were left out."""
    faults: list[Fault] = field(default_factory=list)
    sample: tuple[Part, Pair] | None = None
    """A pair that was driven."""
    log: str = ""
    outcome: Outcome | None = None
    """Of a scenario."""

    @property
    def decided(self) -> bool:
        """Nothing more is found out, whatever is to blame for what goes wrong at its pairs."""
        return len(self.faults) >= ENOUGH or self.hits > 2 * ENOUGH

    @property
    def failed(self) -> bool:
        """FAIL or ERROR."""
        bad = self.outcome is not None and self.outcome.verdict in ("FAIL", "ERROR")
        return bad or bool(self.faults)
