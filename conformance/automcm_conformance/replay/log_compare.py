"""What a log says its station sent and told, beside what another one did with the same inputs.

Each chooses the numbers of its sessions and of its messages.  The n-th session of the one is the
n-th of the other, and so is the n-th message of a type in a session to somebody.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeGuard

from automcm_conformance.adapter.protocol import Object
from automcm_conformance.exchange import transcript
from automcm_spec.vocabulary.messages import LIMIT

TOLD = ("name", "session", "proposal", "reason", "stations")
"""What is compared of an indication."""
Key = tuple[str, int, tuple[int, int]]
"""Messages that only their seq tells apart: type, addressee (0 for all), session."""


class Names:
    """From the names of a log to those of the station that is given its inputs.

    ``me`` is the id of both.  ``numbers`` are those of its own sessions in the log, ascending, if
    the log does not hold all that was sent.
    """

    def __init__(self, me: int, numbers: Sequence[int] = ()) -> None:
        self._me = me
        self._logged, self._own = list(numbers), list[int]()
        self._logged_seqs: dict[Key, list[int]] = {}
        self._own_seqs: dict[Key, list[int]] = {}

    def logged(self, m: Object) -> None:
        """The log says that this message was sent."""
        _note(m, self._logged, self._logged_seqs)

    def sent(self, m: Object) -> None:
        """The station has sent this message."""
        _note(m, self._own, self._own_seqs)

    def session(self, session: list[int]) -> list[int]:
        """A session as the station calls it; what is no session is left as it is."""
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
        """A message received, or sent, with the station's names in it."""
        out = dict(m)
        if "session" in m:
            out["session"] = self.session(m["session"])
        if m["type"] == "CAM" and isinstance(m.get("marks"), list):
            out["marks"] = [self.session(session) for session in m["marks"]]
        if m["type"] == "Ack" and _is_acked(m.get("of")) and _is_session(m.get("session")):
            out["of"] = m["of"] | {"seq": self._acked(m)}
        return out

    def command(self, command: Object) -> Object:
        """A command, or an indication, with the station's names in it."""
        if "session" not in command:
            return command
        return command | {"session": self.session(command["session"])}

    def alike(self, logged: Object, own: Object) -> bool:
        """Whether two messages sent are the same but for a seq, and that has the same place."""
        renamed = self.message(logged)
        if {**renamed, "seq": 0} != {**own, "seq": 0} or not renamed.get("seq"):
            return False
        places = []
        for m, seqs in ((logged, self._logged_seqs), (own, self._own_seqs)):
            known = seqs.get(_key(m), [])
            places.append(known.index(m["seq"]) if m.get("seq") in known else None)
        return places[0] is not None and places[0] == places[1]

    def _acked(self, m: Object) -> int:
        """The seq that an Ack must name."""
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
    value: Object
    several: bool = False
    """It was sent with others, so that which of them has the lower seq is free."""

    def __str__(self) -> str:
        if self.kind == "send":
            return f"send {transcript.message(self.value)}"
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

    def logged(self, line: int, t_ms: int, kind: str, value: Object) -> None:
        """The log has this; ``kind`` is ``send`` or ``tell``."""
        if self.first is None and value.get("type") != "CAM":
            self._log.append(_Done(line, t_ms, kind, value))

    def done(self, line: int, t_ms: int, messages: list[Object], indications: list[Object]) -> None:
        """The station did this, after the input of this line of the log."""
        if self.first is not None:
            return
        several = sum(bool(m.get("seq")) for m in messages) > 1
        self._own += [_Done(line, t_ms, "send", m, several) for m in messages]
        self._own += [_Done(line, t_ms, "tell", i) for i in indications]

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
