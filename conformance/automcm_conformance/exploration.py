"""What an exploration found: plain data, and its JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from automcm_conformance.results import CaseResult, Implementation

Json = Any
FORMAT = "automcm.exploration/1"


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

    def as_dict(self) -> dict[str, Json]:
        """For ``exploration.json``."""
        out = asdict(self)
        out.pop("broke")
        return {"format": FORMAT, "exit_code": self.exit_code, **out}
