"""One exchange with a live station: it runs by its own clock, and is spoken to on the air.

The kit plays the peers.  What must be sent, and when, comes from the oracle as in any exchange
(exchange.py), but nobody writes its lines: an input is sent as a message, and what the station
sends is waited for.  Its application is its own, so what that chooses is taken as it comes.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NoReturn, Protocol, TypeGuard

from pydantic_core import from_json, to_json

from automcm_conformance.adapter.protocol import Object
from automcm_conformance.exchange import transcript
from automcm_conformance.exchange.answers import first_difference
from automcm_conformance.exchange.exchange import Exchange
from automcm_conformance.exchange.results import Line
from automcm_conformance.suite.scripted import number
from automcm_conformance.suite.scripts import THEIRS, Script, Wait
from automcm_spec.vocabulary.messages import same
from automcm_spec.vocabulary.station import Cam, Command, Expire, Input, Message, Receive, Timer
from automcm_traces.checker.finding import Finding, Kind

Came = tuple[int, Object]
"""When a message came, and the message."""


class Air(Protocol):
    """Where the stations are, and the kit's clock, in ms."""

    def now(self) -> int:
        """The time in ms."""

    def send(self, data: bytes) -> None:
        """Send to all stations."""

    def receive(self, until: int) -> tuple[int, bytes] | None:
        """What somebody else sends, and when it came; None if nothing comes by then."""


class Failed(Exception):
    """A case that does not go on.  ``unexpected``: a message that the specification does not allow,
    whenever it comes.  ``overdue``: one that is allowed did not come in time, or came when it was
    not due.  ``cannot_tell``: the station's application did not do what the case needs."""

    def __init__(self, kind: Kind, what: str) -> None:
        self.finding = Finding(kind, observed=what)


class Unwritten:
    """The link of an exchange whose lines nobody gets."""

    def exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        """Never called for what a receiver does."""
        raise AssertionError("a live station has no lines")


class Live:
    """Plays a script with the station of ``x``, which has predictions and no link.

    Each message must come within ``jitter_ms`` of its time.  What is said goes to ``lines``, and
    what it has had to send so far to ``known``, which may hold that of exchanges before.  What is
    sent to ``others``, peers of an exchange that broke off, is overlooked.
    """

    def __init__(
        self,
        x: Exchange,
        air: Air,
        jitter_ms: int,
        lines: list[Line],
        known: list[Object],
        others: Collection[int] = (),
    ) -> None:
        self._x, self._air, self._jitter, self._lines = x, air, jitter_ms, lines
        self._known, self._others = known, others
        self._station = x.wire.values.ids[1]
        self._marks: list[list[int]] | None = None
        """Those of its last CAM, if there was one."""
        self._waiting: Came | None = None
        """What came, but later than it was waited for: the kit itself was not in time."""

    def play(self, script: Script, lease_ms: int) -> None:
        """Raises Failed."""
        for item in script:
            match item:
                case Wait(ms):
                    self._wait(self._later + ms)
                case Expire():
                    self._expire(item)
                case Command():
                    self._decided(item)
                case Receive() | Cam():
                    self._give(item, lease_ms)
        self._wait(self._later + self._x.parameters["t_resend"] + 2 * self._jitter)

    def settle(self, quiet_ms: int, limit_ms: int) -> bool:
        """Whatever went wrong: end its sessions and acknowledge all, until it has been quiet so
        long and its CAMs name no session.  Returns False if the limit is over before."""
        x, period = self._x, self._x.parameters["t_resend"]
        self._others = ()
        self._cancel(x.wire.session(THEIRS))
        begin = quiet_since = self._air.now()
        while (now := self._air.now()) < begin + limit_ms:
            came = self._next(now + period)
            if came is not None:
                quiet_since = came[0]
                self._acknowledge(came[1])
            elif self._marks:
                for session in self._marks:
                    self._cancel(session)
                quiet_since, self._marks = self._air.now(), None
            elif self._marks == [] and self._air.now() >= quiet_since + quiet_ms:
                return True
        return False

    def _cancel(self, session: list[int]) -> None:
        head = {"v": 1, "type": "Cancel", "src": session[0], "dst": self._station}
        self._say(head | {"session": session, "seq": 40, "reason": "abort"})
        self._marks = None

    def _acknowledge(self, m: Object) -> None:
        if m.get("seq"):
            head = {"v": 1, "type": "Ack", "src": m.get("dst"), "dst": self._station}
            of = {"type": m.get("type"), "seq": m["seq"]}
            self._say(head | {"session": m.get("session"), "seq": 0, "of": of})

    @property
    def _later(self) -> int:
        """Now.  The exchange may be ahead by what the station was early."""
        return max(self._x.now, self._air.now())

    # -- what the kit does

    def _give(self, value: Input, lease_ms: int) -> None:
        """Send a message when no timer of the station is about to expire; it is answered."""
        while (due := self._x.next_due) is not None and due <= self._later + self._jitter:
            self._expiry()
        self._quiet(self._air.now())
        at = self._later
        self._x.give(number(self._x, value), at=at, lease_ms=lease_ms)
        self._say(self._x.queued[-1].command["message"])
        self._answered(at + self._jitter)

    def _decided(self, value: Command) -> None:
        """Its application accepts, in its own time."""
        due = self._x.clock.deadline(("decide",))
        came = self._next(due - self._jitter) if due is not None else None
        if came is None:
            raise Failed("cannot_tell", "its application has not decided in time")
        at, m = came
        if m.get("type") == "Acceptance" and m.get("accepted") is False:
            raise Failed("cannot_tell", f"its application has refused: {m.get('reason')}")
        chosen = {"selected": m["selected"]} if _trajectory(m.get("selected")) else None
        self._x.give(number(self._x, value), at=max(self._x.now, at), fields=chosen)
        self._answered(at, came)

    def _wait(self, until: int) -> None:
        """Let time pass; what falls due is sent, also if that is a little later."""
        while (due := self._x.next_due) is not None and due <= until + self._jitter:
            self._expiry()
        self._quiet(until)

    def _expire(self, value: Expire) -> None:
        """Until this timer has expired."""
        fired: list[int] = []
        while number(self._x, value) not in fired:
            if self._x.clock.deadline(value.timer) is None:
                raise Failed(
                    "cannot_tell",
                    f"with these parameters {value.timer[0]} does not come to its end",
                )
            fired = self._expiry()

    def _expiry(self) -> list[int]:
        """The timer that is next expires; what that brings about is sent.  Returns the inputs."""
        x, due = self._x, self._x.next_due
        assert due is not None
        self._quiet(due - self._jitter)
        if not self._brings(x.first_timer):
            return x.advance(due)
        came = self._next(due + self._jitter)
        # What the station armed at this moment counts from when it was awake.
        fired = x.advance(due if came is None else max(due, came[0]))
        self._answered(due + self._jitter, came)
        return fired

    # -- what the station does

    def _answered(self, by: int, came: Came | None = None) -> None:
        """What the last step calls for comes by then.  ``came`` has come already."""
        wanted = list(self._x.queued[-1].expected.messages)
        while wanted or came is not None:
            came = came or self._next(by)
            if came is None:
                self._late(wanted[0], by)
            at, found = came
            match = next((m for m in wanted if self._fits(m, found)), None)
            if match is None:
                self._unexpected(at, found, wanted)
            wanted = [m for m in wanted if m is not match]
            self._known.append(match)
            came = None

    def _fits(self, wanted: Object, found: Object) -> bool:
        """Whether it is this message.  What its application plans is up to it, the first time."""
        new = all(m is not wanted for m in self._known)
        if new and wanted["type"] == "Intention" and _trajectory(found.get("planned")):
            wanted["planned"] = found["planned"]
        return same(wanted, found)

    def _late(self, wanted: Object, by: int) -> NoReturn:
        what = transcript.message(wanted)
        came = self._next(by + 2 * self._x.parameters["t_resend"])
        if came is None:
            raise Failed("overdue", f"{what} was due by {by} and has not come")
        at, found = came
        if self._fits(wanted, found):
            raise Failed("overdue", f"{what} was due by {by} and came at {at}")
        raise Failed(
            "overdue", f"{what} was due by {by}; {transcript.message(found)} came instead at {at}"
        )

    def _quiet(self, until: int) -> None:
        """Nothing comes by then."""
        if (came := self._next(until)) is not None:
            self._unexpected(*came, [])

    def _unexpected(self, at: int, found: Object, wanted: Sequence[Object]) -> NoReturn:
        what = transcript.message(found)
        if any(same(m, found) for m in self._known):
            raise Failed("overdue", f"another copy of {what} came at {at}, and none was due")
        for timer in self._x.clock.running:
            # A CAM that was lost, or a station that slept, is no wrong content.
            if timer[0] != "resend" and any(self._like(m, found) for m in self._brings(timer)):
                due = self._x.clock.deadline(timer)
                raise Failed("overdue", f"{what} came at {at}, and {timer[0]} ends at {due}")
        if wanted:
            raise Failed("unexpected", first_difference(wanted[0], found))
        raise Failed("unexpected", f"sent for no reason: {to_json(found).decode()}")

    def _brings(self, timer: Timer | None) -> Sequence[Message]:
        """The messages that are sent when this timer expires."""
        if timer is None:
            return ()
        answer = self._x.oracle.answer(self._x.state, number(self._x, Expire("expire", timer)))
        return () if answer is None else answer.effect.messages

    def _like(self, m: Message, found: Object) -> bool:
        """Whether a message has the type, the session and the reason of the oracle's."""
        session, reason = self._x.wire.session(m.session), found.get("reason", "none")
        return [m.type, session, m.reason] == [found.get("type"), found.get("session"), reason]

    def _say(self, message: Object) -> None:
        self._air.send(to_json(message))
        self._lines.append(Line(self._air.now(), "kit", transcript.message(message)))

    def _next(self, until: int) -> Came | None:
        """The next message of the station that is no CAM; None if none comes by then."""
        while self._waiting is None and (received := self._air.receive(until)) is not None:
            at, data = received
            m = said_by(self._station, data)
            if m is None:
                continue
            to = m.get("dst")
            if m.get("type") == "CAM":
                self._marks = m["marks"] if _marks(m.get("marks")) else None
            elif type(to) is not int or to not in self._others:
                self._lines.append(Line(at, "station", transcript.message(m)))
                self._waiting = at, m
        if self._waiting is None or self._waiting[0] > until:
            return None
        came, self._waiting = self._waiting, None
        return came


def said_by(station: int, data: bytes) -> Object | None:
    """The message in a datagram, if it is from this station."""
    try:
        m = from_json(data)
    except ValueError:
        return None
    return m if type(m) is dict and m.get("src") == station else None


def _marks(value: object) -> TypeGuard[list[list[int]]]:
    """Whether it has the form of the marks of a CAM."""
    return type(value) is list and all(
        type(session) is list and len(session) == 2 and all(type(n) is int for n in session)
        for session in value
    )


def _trajectory(value: object) -> bool:
    """Whether it has the form of a trajectory."""
    return (
        type(value) is dict
        and value.keys() == {"t0", "points"}
        and type(value["t0"]) is int
        and type(value["points"]) is list
        and len(value["points"]) > 0
        and all(
            type(point) is list and len(point) == 3 and all(type(n) is int for n in point)
            for point in value["points"]
        )
    )
