"""Compares a log's messages and indications with those of another station for the same inputs.

Each station chooses the numbers of its sessions and messages.  The n-th session of one station
corresponds to the n-th of the other, and likewise the n-th message of a type to one addressee in a
session.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeGuard

from automcm_conformance.adapter.protocol import Object
from automcm_conformance.exchange import transcript
from automcm_spec.vocabulary.messages import LIMIT

INDICATION_FIELDS = ("name", "session", "proposal", "reason", "stations")
"""The fields of an indication that are compared."""
Key = tuple[str, int, tuple[int, int]]
"""Type, addressee (0 for all) and session: messages with equal keys differ in their seq only."""


class Renaming:
    """Translates session numbers and seqs of a log to those of the station that gets its inputs.

    ``me`` is the id of both stations.  ``numbers`` are the station's own session numbers in the
    log, ascending, if the log does not contain all messages sent.
    """

    def __init__(self, me: int, numbers: Sequence[int] = ()) -> None:
        self._me = me
        self._logged, self._own = list(numbers), list[int]()
        self._logged_seqs: dict[Key, list[int]] = {}
        self._own_seqs: dict[Key, list[int]] = {}

    def logged(self, m: Object) -> None:
        """Note a message that was sent in the log."""
        _note(m, self._logged, self._logged_seqs)

    def sent(self, m: Object) -> None:
        """Note a message that the station has sent."""
        _note(m, self._own, self._own_seqs)

    def session(self, session: list[int]) -> list[int]:
        """The station's name of a session; a value that is not a session is returned unchanged."""
        if not _is_session(session) or session[0] != self._me:
            return session
        number = session[1]
        if number in self._logged:
            place = self._logged.index(number)
            if place < len(self._own):
                return [self._me, self._own[place]]
            return [self._me, max(self._own, default=0) + 1 + place - len(self._own)]
        taken = number in self._own
        return [self._me, LIMIT - number] if taken else session

    def message(self, m: Object) -> Object:
        """A message, received or sent, with the station's names."""
        out = dict(m)
        if "session" in m:
            out["session"] = self.session(m["session"])
        if m["type"] == "CAM" and isinstance(m.get("marks"), list):
            out["marks"] = [self.session(session) for session in m["marks"]]
        if m["type"] == "Ack" and _is_acked(m.get("of")) and _is_session(m.get("session")):
            out["of"] = m["of"] | {"seq": self._acked(m)}
        return out

    def command(self, command: Object) -> Object:
        """A command or an indication with the station's names."""
        if "session" not in command:
            return command
        return command | {"session": self.session(command["session"])}

    def equivalent(self, logged: Object, own: Object) -> bool:
        """Whether two sent messages differ in their seq only, and are the same n-th message."""
        renamed = self.message(logged)
        if {**renamed, "seq": 0} != {**own, "seq": 0} or not renamed.get("seq"):
            return False
        places = []
        for m, seqs in ((logged, self._logged_seqs), (own, self._own_seqs)):
            known = seqs.get(_key(m), [])
            places.append(known.index(m["seq"]) if m.get("seq") in known else None)
        return places[0] is not None and places[0] == places[1]

    def _acked(self, m: Object) -> int:
        """The seq that an Ack to the station must name."""
        of, src = m["of"], m.get("src")
        seq: int = of["seq"]
        if type(src) is not int:
            return seq
        logged = self._logged_seqs.get((of["type"], src, tuple(m["session"])), [])
        p, number = self.session(m["session"])
        own = self._own_seqs.get((of["type"], src, (p, number)), [])
        if seq in logged and logged.index(seq) < len(own):
            return own[logged.index(seq)]
        return LIMIT if seq in own else seq


def _note(m: Object, numbers: list[int], seqs: dict[Key, list[int]]) -> None:
    session, seq = m.get("session"), m.get("seq")
    if m["type"] in ("CAM", "Ack") or not _is_session(session) or type(seq) is not int:
        return
    if m["type"] == "Advertisement" and session[1] not in numbers:
        numbers.append(session[1])
    known = seqs.setdefault(_key(m), [])
    if seq and seq not in known:
        known.append(seq)


def _key(m: Object) -> Key:
    return m["type"], m.get("dst", 0), tuple(m["session"])


def _is_session(value: object) -> TypeGuard[list[int]]:
    return isinstance(value, list) and len(value) == 2 and all(type(n) is int for n in value)


def _is_acked(value: object) -> bool:
    return (
        isinstance(value, dict)
        and type(value.get("seq")) is int
        and isinstance(value.get("type"), str)
    )


@dataclass(frozen=True, slots=True)
class LogDifference:
    """The first difference; ``line`` is a line of the log.

    ``log`` or ``station`` is empty if nothing there corresponds to the other.
    """

    line: int
    t_ms: int
    log: str
    station: str


@dataclass(slots=True)
class _Observed:
    """A sent message or an indication that has not been matched yet."""

    line: int
    t_ms: int
    kind: str
    value: Object
    together: bool = False
    """It was sent together with others, so the order of their seqs is free."""

    def __str__(self) -> str:
        if self.kind == "send":
            return f"send {transcript.message(self.value)}"
        values = [str(self.value[name]) for name in INDICATION_FIELDS if name in self.value]
        return f"indication {' '.join(values)}"


@dataclass(slots=True)
class LogComparison:
    """Compares the log with the station step by step.

    Equal observations match if they are at most ``late_ms`` apart.  CAMs are left out, because
    their times and positions are free.
    """

    names: Renaming
    late_ms: int
    first: LogDifference | None = None
    _log: list[_Observed] = field(default_factory=list)
    _own: list[_Observed] = field(default_factory=list)

    def logged(self, line: int, t_ms: int, kind: str, value: Object) -> None:
        """Note a message or an indication of the log; ``kind`` is ``send`` or ``indication``."""
        if self.first is None and value.get("type") != "CAM":
            self._log.append(_Observed(line, t_ms, kind, value))

    def done(self, line: int, t_ms: int, messages: list[Object], indications: list[Object]) -> None:
        """Note the station's messages and indications after the input on this line of the log."""
        if self.first is not None:
            return
        together = sum(bool(m.get("seq")) for m in messages) > 1
        self._own += [_Observed(line, t_ms, "send", m, together) for m in messages]
        self._own += [_Observed(line, t_ms, "indication", i) for i in indications]

    def settle(self, now: int, *, ends: bool = False) -> None:
        """Match the observations; one that stays unmatched for ``late_ms`` is a difference.

        ``ends``: the log has ended, so every unmatched observation of the log is a difference.
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
        unmatched = min([*old, *own], key=lambda each: (each.t_ms, each.line))
        others = self._own if unmatched in old else self._log
        other = next((each for each in others if self._similar(unmatched, each)), None)
        pair = (unmatched, other) if unmatched in old else (other, unmatched)
        log, station = ("" if each is None else str(each) for each in pair)
        if log == station:
            log, station = self._with_difference(*pair)
        line = pair[0].line if pair[0] is not None else unmatched.line
        self.first = LogDifference(line, unmatched.t_ms, log, station)

    def _with_difference(self, log: _Observed | None, own: _Observed | None) -> tuple[str, str]:
        """Both as text with the field that differs, if their usual texts are equal."""
        assert log is not None and own is not None
        expected = self.names.message(log.value) if log.kind == "send" else log.value
        for name in sorted(expected.keys() | own.value.keys()):
            if expected.get(name) != own.value.get(name):
                return f"{log}, {name} {expected.get(name)}", f"{own}, {name} {own.value.get(name)}"
        return f"{log} at {log.t_ms} ms", f"{own} at {own.t_ms} ms"

    def _same(self, log: _Observed, own: _Observed) -> bool:
        if log.kind != own.kind or abs(log.t_ms - own.t_ms) > self.late_ms:
            return False
        if log.kind == "indication":
            renamed = self.names.command(log.value)
            return all(
                renamed.get(n) == own.value.get(n) for n in INDICATION_FIELDS if n in renamed
            )
        if self.names.message(log.value) == own.value:
            return True
        return own.together and self.names.equivalent(log.value, own.value)

    def _similar(self, one: _Observed, other: _Observed) -> bool:
        """Whether one was observed instead of the other: same kind and type, at about that time."""
        name = "type" if one.kind == "send" else "name"
        near = abs(one.t_ms - other.t_ms) <= self.late_ms
        return one.kind == other.kind and near and one.value[name] == other.value[name]
