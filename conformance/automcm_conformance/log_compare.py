"""What a log says its station sent and told, beside what another one did with the same inputs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from automcm_conformance import words
from automcm_conformance.log_names import Names

Json = Any
TOLD = ("name", "session", "proposal", "reason", "stations")
"""What is compared of an indication."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The first thing that the one did and the other did not; ``line`` is that of the log.

    One of ``log`` and ``station`` may be empty: nothing like it was done there.
    """

    line: int
    t_ms: int
    log: str
    station: str


@dataclass(slots=True)
class _Done:
    """A message sent or an indication, not yet found on the other side."""

    line: int
    t_ms: int
    kind: str
    value: dict[str, Json]
    several: bool = False
    """It was sent with others, so that which of them has the lower seq is free."""

    def __str__(self) -> str:
        if self.kind == "send":
            return f"send {words.message(self.value)}"
        return f"tell {' '.join(str(self.value[n]) for n in TOLD if n in self.value)}"


@dataclass(slots=True)
class Compared:
    """Two sides, in step.  What is done at most ``late_ms`` earlier or later is the same.

    CAMs are left out: their times and places are free.
    """

    names: Names
    late_ms: int
    first: Difference | None = None
    _log: list[_Done] = field(default_factory=list)
    _own: list[_Done] = field(default_factory=list)

    def logged(self, line: int, t_ms: int, kind: str, value: dict[str, Json]) -> None:
        """The log has this; ``kind`` is ``send`` or ``tell``."""
        if self.first is None and value.get("type") != "CAM":
            self._log.append(_Done(line, t_ms, kind, value))

    def done(
        self, line: int, t_ms: int, messages: list[dict[str, Json]], told: list[dict[str, Json]]
    ) -> None:
        """The station did this, after the input of this line of the log."""
        if self.first is not None:
            return
        several = sum(bool(m.get("seq")) for m in messages) > 1
        self._own += [_Done(line, t_ms, "send", m, several) for m in messages]
        self._own += [_Done(line, t_ms, "tell", i) for i in told]

    def settle(self, now: int, *, ends: bool = False) -> None:
        """Match what can be matched; what is older than ``late_ms`` then is a difference.

        ``ends``: nothing follows in the log, so that nothing in it is found any more.
        """
        if self.first is not None:
            return
        for each in list(self._log):
            match = next((own for own in self._own if self._same(each, own)), None)
            if match is not None:
                self._log.remove(each)
                self._own.remove(match)
        old = [each for each in self._log if ends or each.t_ms < now - self.late_ms]
        own = [each for each in self._own if each.t_ms < now - self.late_ms]
        if not old and not own:
            return
        lone = min([*old, *own], key=lambda each: (each.t_ms, each.line))
        others = self._own if lone in old else self._log
        other = next((each for each in others if self._like(lone, each)), None)
        pair = (lone, other) if lone in old else (other, lone)
        log, station = ("" if each is None else str(each) for each in pair)
        if log == station:
            log, station = self._apart(*pair)
        line = pair[0].line if pair[0] is not None else lone.line
        self.first = Difference(line, lone.t_ms, log, station)

    def _apart(self, log: _Done | None, own: _Done | None) -> tuple[str, str]:
        """Both in words, if what is different is no part of the words."""
        assert log is not None and own is not None
        wanted = self.names.message(log.value) if log.kind == "send" else log.value
        for name in sorted(wanted.keys() | own.value.keys()):
            if wanted.get(name) != own.value.get(name):
                return f"{log}, {name} {wanted.get(name)}", f"{own}, {name} {own.value.get(name)}"
        return f"{log} at {log.t_ms} ms", f"{own} at {own.t_ms} ms"

    def _same(self, log: _Done, own: _Done) -> bool:
        if log.kind != own.kind or abs(log.t_ms - own.t_ms) > self.late_ms:
            return False
        if log.kind == "tell":
            renamed = self.names.command(log.value)
            return all(renamed.get(n) == own.value.get(n) for n in TOLD if n in renamed)
        if self.names.message(log.value) == own.value:
            return True
        return own.several and self.names.alike(log.value, own.value)

    def _like(self, one: _Done, other: _Done) -> bool:
        """Whether the one was done instead of the other."""
        name = "type" if one.kind == "send" else "name"
        near = abs(one.t_ms - other.t_ms) <= self.late_ms
        return one.kind == other.kind and near and one.value[name] == other.value[name]
