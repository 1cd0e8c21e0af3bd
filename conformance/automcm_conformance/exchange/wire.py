"""Maps the oracle's values to the lines of an adapter: one station, one exchange.

The oracle knows no content, no counter behind seq, and no ids but 1, 2, 3 and 9. ``Wire`` chooses
them, remembers the messages, and turns each input into a line and each answer of the oracle into
the exact expected answer (docs/adapter.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, get_args

from pydantic_core import to_json

from automcm_spec.graph.oracle import OracleAnswer
from automcm_spec.vocabulary import station as spec
from automcm_spec.vocabulary import wire_forms
from automcm_spec.vocabulary.messages import ANSWER_REASONS, LIMIT, RefusalReason
from automcm_spec.vocabulary.parameters import TIMERS

Json = Any

ME, STRANGER = 1, 9
HOLD_MS = 2_000
LONG_MS = 5_000_000
"""A lease that outlasts every exchange."""
LONG = {
    "cam": 1_000_000,
    "hold": 2_000_000,
    "decide": 2_100_000,
    "answer": 2_200_000,
    "advertise": 2_300_000,
    "resend": 3_000_000,
    "giveup": 3_100_000,
    "quarantine": 4_000_000,
    "forget": 4_100_000,
    "backoff": 4_200_000,
    "lease": LONG_MS,
}
"""Durations of timers that need not expire. An answer reports the earliest deadline, so a timer
that is wrongly armed again should have it."""
LONG |= {name: 4_300_000 for name in TIMERS if name not in LONG}
SOON_MS = 900_000
"""A duration shorter than all of these."""


ODD_SEQ = 77
POINTS = 1_000
"""The points of a long trajectory; with these values its message fits a datagram."""
BEFORE_MS = 150
"""The age of a CAM that would not be newer than the first."""
STEP_MS = 100
COPY_REASONS = tuple(r for r in get_args(RefusalReason) if r not in ANSWER_REASONS)


Key = tuple[str, int, spec.Session, int]
"""The key of an outbox entry: type, addressee, session, seq, in the oracle's values."""


@dataclass(frozen=True, slots=True)
class Values:
    """The real values of the oracle's values.

    ``ids``: the id of each station. ``numbers``: session numbers of the other stations, by the
    oracle's number. ``start_ms``: the time at which the exchange begins.
    """

    ids: Mapping[int, int]
    numbers: Mapping[int, tuple[int, ...]]
    start_ms: int = 1_000


PLAIN = Values(
    {0: 0, ME: 4711, 2: 1702, 3: 10203, STRANGER: 999},
    {2: (0, 5, 8), 3: (0, 2, 40), STRANGER: (0, 17)},
)
ALIKE = Values(
    {0: 0, ME: 10, 2: 9, 3: 100, STRANGER: 1},
    {2: (0, 1, 2), 3: (0, 1, 2), STRANGER: (0, 1)},
)
"""Numbers that stations share, also with the station under test; ids whose order as texts differs
from their order as numbers."""
WIDE = Values(
    {0: 0, ME: 2**32 - 1, 2: 2**16 + 9, 3: 2**32 - 2**16 - 1, STRANGER: 2**31 + 9},
    {2: (0, 5, 2**32 + 5), 3: (0, 2**49 + 1, 2**49 + 2), STRANGER: (0, 2**32 + 5)},
    start_ms=2**41,
)
"""Values that 16 or 32 bits, or single-precision floats, cannot hold or distinguish."""
VALUES = (PLAIN, ALIKE, WIDE)
RICH_DETAILS = {
    "lane": 2,
    "text": 'quotes " and \\ and / and \u00e4\u4e2d\U0001f698 and \n',
    "deep": {"list": [1, [2, {"x": []}], True, False, ""], "large": [LIMIT, -LIMIT, 0]},
}
"""Content that a station must carry unchanged."""


@dataclass(slots=True)
class Required:
    """The answer that the specification requires.

    ``messages`` of one input may come in any order, and those of the next one after them: it
    ``begins`` at these. A value that the station chooses is None until it is known:
    ``seq``, if several new messages share the numbers in ``fresh``, and the number of a session
    that it opens, which must be ``above`` the last. ``deadline`` may be UNKNOWN. ``marks`` are
    those of the states before, between and after, each ``marks_since`` a time in ms: a CAM has
    those of the time at which it is due. Empty if CAMs are not judged.
    """

    rule: str = ""
    messages: list[dict[str, Json]] = field(default_factory=list)
    indications: list[dict[str, Json]] = field(default_factory=list)
    deadline: int | None = None
    phase: str = ""
    marks: Sequence[Json] = ()
    marks_since: Sequence[int] = ()
    fresh: list[int] = field(default_factory=list)
    above: int = 0
    begins: list[int] = field(default_factory=list)
    timer: str = ""
    """The name of the timer with that deadline."""


@dataclass(slots=True)
class Wire:
    """The messages and commands of an exchange so far, in real values.

    Call ``command`` before each input, ``expect`` with each answer of the oracle, and ``opened``
    with the number of a session that the station opened.
    """

    scenario: str = "lane_change"
    rich: bool = False
    """Long and unusual content."""
    values: Values = PLAIN
    last_number: int = 0
    own: dict[int, int] = field(default_factory=dict)
    outbox: dict[Key, dict[str, Json]] = field(default_factory=dict)
    advertisement: dict[str, Json] | None = None
    seq: int = 0
    heard_ms: int | None = None
    first_cam_ms: tuple[int, int] | None = None
    """When the first CAM that counted was generated and received (ACT-5)."""
    given: dict[str, Json] | None = None
    """The message or command in the last line."""
    fresh: list[int] = field(default_factory=list)
    """The numbers that several new messages of the last step share."""
    _cache: dict[spec.Message, dict[str, Json]] = field(default_factory=dict)
    """Received messages with their content, which a copy repeats."""

    # -- content and ids

    def trajectory(self, session: Sequence[int], k: int, lane: int) -> Json:
        """A trajectory that no other session, proposal or use has."""
        points = [[0, 0, 0], [1000, 8000 + lane, session[0]]]
        if self.rich:
            points += [[1000 + 40 * n, -n * n, LIMIT - n] for n in range(1, POINTS - 1)]
        return {"t0": (10 * session[1] + k) % LIMIT, "points": points}

    def station(self, station: int) -> int:
        """The id of a station."""
        return self.values.ids[station]

    def session(self, s: spec.Session) -> list[int]:
        """A session in real ids. An own session that is not open yet has a later number."""
        if s[0] == ME:
            later = self.last_number + s[1] - len(self.own)
            return [self.values.ids[ME], self.own.get(s[1], later)]
        return [self.values.ids[s[0]], self.values.numbers[s[0]][s[1]]]

    def real(self, s: spec.Session) -> spec.Session:
        """The same as a value of the specification; nobody stays nobody."""
        if s[0] == 0:
            return s
        station, number = self.session(s)
        return station, number

    def opened(self, place: int, number: int) -> None:
        """Record the number under which the station opened its session ``place``."""
        if self.session((ME, place)) != [self.values.ids[ME], number]:
            self._cache.clear()
        self.own[place] = self.last_number = number

    # -- inputs

    def command(self, value: spec.Input, now: int, lease_ms: int | None = None) -> dict[str, Json]:
        """The adapter command for an input at ``now``, without that field.

        ``lease_ms`` is for a Prescription with new content; a copy repeats its lease.
        """
        self.given = None
        match value:
            case spec.Receive():
                self.given = self.message(value.message, lease_ms)
                out: dict[str, Json] = {"cmd": "receive", "message": self.given}
                if value.message.type == "Advertisement" and value.concerned:
                    out["planned"] = self.trajectory(self.given["session"], 0, 1)
                return out
            case spec.Cam():
                self.given = self._cam(value, now)
                return {"cmd": "receive", "message": self.given}
            case spec.Command():
                self.given = self._command(value, lease_ms or LONG_MS + value.proposal)
                return {"cmd": "command", "command": self.given}
        return {"cmd": "restart" if isinstance(value, spec.Restart) else "advance"}

    def message(self, m: spec.Message, lease_ms: int | None = None) -> dict[str, Json]:
        """A received message with content."""
        if m.type == "Ack":
            about = {"type": m.of[0], "seq": self._acked(m)}
            return wire_forms.message(self, m, 0, lambda name: about)
        if m not in self._cache or lease_ms is not None:
            self._cache[m] = self._received(m, lease_ms or LONG_MS + m.proposal)
        return self._cache[m]

    def _received(self, m: spec.Message, lease_ms: int) -> dict[str, Json]:
        s, k, seq = self.session(m.session), m.proposal, 0
        if m.seq:
            first = {"Prescription": 1 + k, "Acceptance": (1 if m.accepted else 11) + k}
            seq = first.get(m.type, {"Fin": 30, "Cancel": 40}.get(m.type, 1))
            seq += 2**40 if self.rich else 0

        def content(name: str) -> Json:
            match name:
                case "scenario":
                    return self.scenario
                case "details":
                    return RICH_DETAILS if self.rich else {"lane": 2}
                case "planned":
                    return self.trajectory(s, 0, m.src)
                case "prescribed":
                    return self.trajectory(s, k, 2)
                case "selected":
                    return self.trajectory(s, k, 3)
                case "reason" if m.reason == "as_sent":
                    return COPY_REASONS[k % 2] if m.type == "Acceptance" else "abort"
                case "hold_ms":
                    return HOLD_MS + k
                case "lease_ms":
                    return lease_ms
            return m.reason

        return wire_forms.message(self, m, seq, content)

    def _acked(self, m: spec.Message) -> int:
        """The seq that an Ack names. One that acknowledges no outbox entry names a seq that tests
        the check of END-6."""
        type_, k = m.of
        mine = self.outbox.get((type_, m.src, m.session, k))
        if not k:
            return 0
        if mine is not None:
            return int(mine["seq"])
        if type_ == "Advertisement":
            return 1
        # That of an entry to another station, of another type to the sender, or of no entry.
        src, session = self.values.ids[m.src], self.session(m.session)
        own = [e for e in self.outbox.values() if e["session"] == session]
        foreign = (e["seq"] for e in own if e["dst"] != src and e["type"] == type_)
        other = (e["seq"] for e in own if e["dst"] == src and e["type"] != type_)
        return next(foreign, next(other, ODD_SEQ))

    def _cam(self, value: spec.Cam, now: int) -> dict[str, Json]:
        if self.heard_ms is None or self.first_cam_ms is None:
            last = now - BEFORE_MS
            new = last + STEP_MS
        else:
            last, (generated, received) = self.heard_ms, self.first_cam_ms
            new = max(last + 1, generated + now - received)
        return wire_forms.cam(self, value.src, value.marks, new if value.newer else last)

    def _command(self, value: spec.Command, lease_ms: int) -> dict[str, Json]:
        details = {"lane": 2, "request": len(self.own) + 1} | (RICH_DETAILS if self.rich else {})
        plain: Json = {"scenario": self.scenario, "details": details}
        plain |= {"hold_ms": HOLD_MS, "lease_ms": lease_ms}

        def content(name: str) -> Json:
            lane = {"prescribed": 4, "selected": 5}.get(name)
            if lane is None:
                return plain[name]
            return self.trajectory(self.session(value.session), value.proposal, lane)

        out = wire_forms.command(self, value, content)
        if value.name == "request" and self.rich:
            out["planned"] = self.trajectory([0, 0], 0, 6)
        return out

    # -- answers

    def expect(
        self,
        before: spec.State,
        value: spec.Input,
        answer: OracleAnswer,
        after: spec.State,
        lease_left: int,
        now: int,
    ) -> tuple[list[dict[str, Json]], list[dict[str, Json]]]:
        """The expected messages and indications; reliable messages are remembered.

        Several new messages of one step have ``seq`` None; the numbers are in ``fresh``.
        """
        effect = answer.effect
        messages = []
        new: list[tuple[Key, dict[str, Json]]] = []
        for m in effect.messages:
            key = m.type, m.dst, m.session, m.seq
            if m.seq and key in self.outbox:
                messages.append(self.outbox[key])
            elif m.type == "Advertisement" and self.advertisement is not None:
                messages.append(self.advertisement)
            else:
                message = self._sent(m)
                messages.append(message)
                if m.seq:
                    new.append((key, message))
        if answer.changes:
            self._remember(before, after, new, value, now)
        return messages, self._indications(effect.indication, before, after, lease_left)

    def _sent(self, m: spec.Message) -> dict[str, Json]:
        """A new message, or an answer, of the station."""
        given = self.given or {}

        def content(name: str) -> Json:
            match name:
                case "planned":
                    return self.trajectory(self.session(m.session), 0, 1)
                case "reason":
                    return m.reason
                case "of":
                    return {"type": given["type"], "seq": given["seq"]}
            return given[name]

        out = wire_forms.message(self, m, None if m.seq else 0, content)
        if m.type == "Advertisement":
            out["session"] = [self.values.ids[ME], None]
            out |= {"planned": given["planned"]} if "planned" in given else {}
        return out

    def _remember(
        self,
        before: spec.State,
        after: spec.State,
        new: list[tuple[Key, dict[str, Json]]],
        value: spec.Input,
        now: int,
    ) -> None:
        if before.session != after.session:
            if before.session == (0, 0):
                self.seq = 0
            self.advertisement = self.heard_ms = self.first_cam_ms = None
        if len(new) == 1 and new[0][1]["type"] != "Advertisement":
            new[0][1]["seq"] = self.seq + 1
        else:
            self.fresh = [self.seq + n for n in range(1, len(new) + 1)]
        self.seq += len(new)
        for key, message in new:
            if message["type"] == "Advertisement":
                self.advertisement = message
            else:
                self.outbox[key] = message
        for key in self.outbox.keys() - {entry[:4] for entry in after.outbox}:
            del self.outbox[key]
        if after.phase != "ADVERTISING":
            self.advertisement = None
        if isinstance(value, spec.Cam) and self.given is not None:
            self.heard_ms = generated = self.given["generation_ms"]
            self.first_cam_ms = self.first_cam_ms or (generated, now)
        elif after.phase != "ACTUATING":
            self.heard_ms = self.first_cam_ms = None

    def _indications(
        self, indication: tuple[str, ...], before: spec.State, after: spec.State, lease_left: int
    ) -> list[dict[str, Json]]:
        name = indication[0]
        if name == "nothing":
            return []
        if name in ("refused", "discarded"):
            return [{"name": name}]
        given = self.given or {}
        out: dict[str, Json] = {"name": name, "session": self.session(before.session)}
        match name:
            case "choose":
                out["stations"] = sorted(self.values.ids[p] for p in after.recorded)
            case "verify":
                out |= {"proposal": given["proposal"], "prescribed": given["prescribed"]}
            case "undecided":
                out["proposal"] = before.proposal
            case "accepted":
                out |= {"proposal": before.proposal, "selected": given["selected"]}
                out["lease_left_ms"] = lease_left
            case "propose":
                out |= {"proposal": before.proposal + 1, "reason": given["reason"]}
            case "fallback":
                out["reason"] = given["reason"] if indication[1] == "as_sent" else indication[1]
        return [out]

    def timer(self, t: spec.Timer) -> dict[str, Json]:
        """A timer as in a log, but with its whole message, whose seq may not be known yet."""
        match t:
            case (name, spec.Entry() as e):
                message = self.outbox.get(e[:4])
                if message is None:
                    message = {"type": e.type, "session": self.session(e.session), "seq": 1}
                    message |= {"dst": self.values.ids[e.to]} if e.to else {}
                return {"name": name, "message": message}
            case (name, int(p)):
                return {"name": name, "station": self.values.ids[p]}
        return {"name": t[0]}


def encode(command: dict[str, Json]) -> bytes:
    """The line of a command."""
    return to_json(command) + b"\n"
