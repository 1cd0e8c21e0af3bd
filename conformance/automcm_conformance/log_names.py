"""Names in a log that its station chose: numbers of its sessions and of its messages.

Another station chooses others.  The n-th session of the one is the n-th of the other, and so is
the n-th message of a type in a session to somebody.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from automcm_spec.messages import LIMIT

Json = Any
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

    def logged(self, m: dict[str, Json]) -> None:
        """The log says that this message was sent."""
        _note(m, self._logged, self._logged_seqs)

    def sent(self, m: dict[str, Json]) -> None:
        """The station has sent this message."""
        _note(m, self._own, self._own_seqs)

    def session(self, session: Json) -> Json:
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

    def message(self, m: dict[str, Json]) -> dict[str, Json]:
        """A message received, or sent, with the station's names in it."""
        out = dict(m)
        if "session" in m:
            out["session"] = self.session(m["session"])
        if m["type"] == "CAM" and isinstance(m.get("marks"), list):
            out["marks"] = [self.session(session) for session in m["marks"]]
        if m["type"] == "Ack" and _is_acked(m.get("of")) and _is_session(m.get("session")):
            out["of"] = m["of"] | {"seq": self._acked(m)}
        return out

    def command(self, command: dict[str, Json]) -> dict[str, Json]:
        """A command, or an indication, with the station's names in it."""
        if "session" not in command:
            return command
        return command | {"session": self.session(command["session"])}

    def alike(self, logged: dict[str, Json], own: dict[str, Json]) -> bool:
        """Whether two messages sent are the same but for a seq, and that has the same place."""
        renamed = self.message(logged)
        if {**renamed, "seq": 0} != {**own, "seq": 0} or not renamed.get("seq"):
            return False
        places = []
        for m, seqs in ((logged, self._logged_seqs), (own, self._own_seqs)):
            known = seqs.get(_key(m), [])
            places.append(known.index(m["seq"]) if m.get("seq") in known else None)
        return places[0] is not None and places[0] == places[1]

    def _acked(self, m: dict[str, Json]) -> int:
        """The seq that an Ack must name."""
        of, src = m["of"], m.get("src")
        seq: int = of["seq"]
        if type(src) is not int:
            return seq
        logged = self._logged_seqs.get((of["type"], src, tuple(m["session"])), [])
        own = self._own_seqs.get((of["type"], src, tuple(self.session(m["session"]))), [])
        if seq in logged and logged.index(seq) < len(own):
            return own[logged.index(seq)]
        return LIMIT if seq in own else seq


def _note(m: dict[str, Json], numbers: list[int], seqs: dict[Key, list[int]]) -> None:
    session: Json = m.get("session")
    seq: Json = m.get("seq")
    if m["type"] in ("CAM", "Ack") or not _is_session(session) or type(seq) is not int:
        return
    if m["type"] == "Advertisement" and session[1] not in numbers:
        numbers.append(session[1])
    known = seqs.setdefault(_key(m), [])
    if seq and seq not in known:
        known.append(seq)


def _key(m: dict[str, Json]) -> Key:
    return m["type"], m.get("dst", 0), tuple(m["session"])


def _is_session(value: Json) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(type(n) is int for n in value)


def _is_acked(value: Json) -> bool:
    return (
        isinstance(value, dict)
        and type(value.get("seq")) is int
        and isinstance(value.get("type"), str)
    )
