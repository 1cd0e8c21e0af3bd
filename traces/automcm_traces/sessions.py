"""The sessions in one station's log: which, in which role, from where to where, how they ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from automcm_spec.rules import RULES
from automcm_traces.follow import Watcher
from automcm_traces.step import Step
from automcm_traces.track import Track

Json = Any
MOST = 100
"""Sessions that are kept; the last ones, the others are counted only."""


@dataclass(slots=True)
class Session:
    """One session as its station took part in it."""

    session: tuple[int, int]
    role: str
    first: int
    """Line of the input by which it began."""
    phases: list[str]
    last: int = 0
    """Line of the input by which it ended; 0 if the log ends in it."""
    rule: str = ""
    """The rule by which it ended."""

    def as_dict(self) -> dict[str, Json]:
        """As in ``--json``."""
        return {
            "session": list(self.session),
            "role": self.role,
            "phases": self.phases,
            "first": self.first,
            "last": self.last,
            "rule": self.rule,
        }

    def __str__(self) -> str:
        name = f"session {self.session[0]}/{self.session[1]} as {self.role}"
        way = " > ".join(self.phases)
        if not self.last:
            return f"{name}, from line {self.first}: {way}, still in it"
        why = RULES.get(self.rule, "")
        return f"{name}, lines {self.first} to {self.last}: {way}; ended by {self.rule}: {why}"


class Sessions(Watcher):
    """Watches the steps of a station."""

    def __init__(self) -> None:
        self.kept: list[Session] = []
        self.number = 0

    def step(self, step: Step, track: Track) -> None:
        """Follow a step."""
        current = self.kept[-1] if self.kept and not self.kept[-1].last else None
        if current is not None and current.session != track.session:
            current.last, current.rule = step.at, step.rule
            current = None
        if track.session is None:
            return
        if current is None:
            self.number += 1
            current = Session(track.session, track.role, step.at, [])
            self.kept = [*self.kept[1 - MOST :], current]
        if current.phases[-1:] != [track.phase]:
            current.phases.append(track.phase)
