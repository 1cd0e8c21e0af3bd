"""Timers of a station as the kit keeps them: which of them fires next."""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter
from typing import Any

Json = Any
UNKNOWN = -1
"""A time that only the station knows."""


@dataclass(slots=True)
class Running:
    """An armed timer.  ``age`` orders those of one rank: an older message comes first."""

    timer: Json
    deadline: int
    rank: int
    age: int


TURN = attrgetter("deadline", "rank", "age")
"""Timers fire in the order of this."""
