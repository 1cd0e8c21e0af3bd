"""Tours over one part of the suite, planned and being played."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from automcm_conformance.exchange import Exchange
from automcm_conformance.purposes import Owners
from automcm_conformance.tally import Part
from automcm_conformance.tour import Pair, Tours
from automcm_conformance.wire import Values


@dataclass(slots=True)
class Flight:
    """A tour that is being played."""

    x: Exchange
    tour: list[int]
    lease: int
    values: Values
    soonest: str
    off: Pair | None = None
    """What time forbids; the tour ends there."""


@dataclass(slots=True)
class Drive:
    """Tours over one part."""

    part: Part
    owners: Owners
    tours: Tours
    planned: int
    started: int = 0
    flights: list[Flight] = field(default_factory=list)
    """Played, with lines that wait to be sent."""
    sent: list[Flight] = field(default_factory=list)
    """Those whose lines the station is answering."""
    attempts: Counter[Pair] = field(default_factory=Counter)

    @property
    def lines(self) -> int:
        """How many are waiting."""
        return sum(flight.x.unwritten for flight in self.flights)
