"""Translates the inputs of a log for another station.

Each station chooses the numbers of its sessions and messages.  The n-th session of one station
corresponds to the n-th of the other, and likewise the n-th message of a type to one addressee in a
session.
"""

from __future__ import annotations

from collections.abc import Sequence

from automcm_conformance.adapter.protocol import Object
from automcm_spec.vocabulary.messages import LIMIT, session_in

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
        if session_in(session) is None or session[0] != self._me:
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
        """A received message with the station's names."""
        out = dict(m)
        if "session" in m:
            out["session"] = self.session(m["session"])
        if m["type"] == "CAM" and isinstance(m.get("marks"), list):
            out["marks"] = [self.session(session) for session in m["marks"]]
        if m["type"] == "Ack" and _is_acked(m.get("of")) and session_in(m.get("session")):
            out["of"] = m["of"] | {"seq": self._acked(m)}
        return out

    def command(self, command: Object) -> Object:
        """A command with the station's names."""
        if "session" not in command:
            return command
        return command | {"session": self.session(command["session"])}

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
    session, seq = session_in(m.get("session")), m.get("seq")
    if m["type"] in ("CAM", "Ack") or session is None or type(seq) is not int:
        return
    if m["type"] == "Advertisement" and session[1] not in numbers:
        numbers.append(session[1])
    known = seqs.setdefault(_key(m), [])
    if seq and seq not in known:
        known.append(seq)


def _key(m: Object) -> Key:
    return m["type"], m.get("dst", 0), tuple(m["session"])


def _is_acked(value: object) -> bool:
    return (
        isinstance(value, dict)
        and type(value.get("seq")) is int
        and isinstance(value.get("type"), str)
    )
