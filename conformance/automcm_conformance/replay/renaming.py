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
        """A received well-formed message with the station's names."""
        if m["type"] == "CAM":
            return m | {"marks": [self.session(session) for session in m["marks"]]}
        of = {"of": m["of"] | {"seq": self._acked(m)}} if m["type"] == "Ack" else {}
        return m | {"session": self.session(m["session"])} | of

    def command(self, command: Object) -> Object:
        """A command with the station's names."""
        if "session" not in command:
            return command
        return command | {"session": self.session(command["session"])}

    def _acked(self, m: Object) -> int:
        """The seq that an Ack to the station must name."""
        type_, src = m["of"]["type"], m["src"]
        seq: int = m["of"]["seq"]
        p, number = m["session"]
        logged = self._logged_seqs.get((type_, src, (p, number)), [])
        p, number = self.session([p, number])
        own = self._own_seqs.get((type_, src, (p, number)), [])
        if seq in logged and logged.index(seq) < len(own):
            return own[logged.index(seq)]
        return LIMIT if seq in own else seq


def _note(m: Object, numbers: list[int], seqs: dict[Key, list[int]]) -> None:
    session, seq = session_in(m.get("session")), m.get("seq")
    if m["type"] in ("CAM", "Ack") or session is None or type(seq) is not int:
        return
    if m["type"] == "Advertisement" and session[1] not in numbers:
        numbers.append(session[1])
    known = seqs.setdefault((m["type"], m.get("dst", 0), session), [])
    if seq and seq not in known:
        known.append(seq)
