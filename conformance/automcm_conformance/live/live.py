"""One exchange with a live station, which runs by its own clock and is reached by radio only.

The kit plays the peers.  As in any exchange (exchange.py) the oracle predicts the messages and
their times, but there are no lines of an adapter: the kit sends messages and waits for those of
the station.  The station has its own application, whose choices the kit accepts.
"""

from __future__ import annotations

import select
import time
from collections.abc import Collection, Sequence
from socket import socket
from typing import Any, Literal, NoReturn

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic_core import from_json, to_json

from automcm_conformance.adapter.protocol import Object
from automcm_conformance.exchange import transcript
from automcm_conformance.exchange.answers import first_difference, unexpected_message
from automcm_conformance.exchange.exchange import Exchange
from automcm_conformance.exchange.results import Line
from automcm_conformance.suite.scripted import number
from automcm_conformance.suite.scripts import THEIRS, Script, Wait
from automcm_spec.vocabulary.messages import ExtentMm, Session, Trajectory, same
from automcm_spec.vocabulary.station import Cam, Command, Expire, Input, Message, Receive, Timer

LARGEST = 65_535
"""The maximum size of a datagram in bytes."""

Received = tuple[int, Object]
"""A message and the time in ms at which it was received."""


_STRICT = ConfigDict(strict=True)
TRAJECTORY, EXTENT = TypeAdapter(Trajectory), TypeAdapter[int](ExtentMm, config=_STRICT)
MARKS = TypeAdapter(list[Session], config=_STRICT)


class UdpAir:
    """UDP as a live station's radio: each message is a datagram of JSON (docs/messages.md).

    ``own`` is the socket that sends and receives the stations' answers.  ``shared`` is the socket
    on the broadcast address ``everyone``.  The caller binds and closes both.
    """

    def __init__(self, own: socket, shared: socket, everyone: tuple[str, int]) -> None:
        self._own, self._sockets, self._everyone = own, (own, shared), everyone
        self._name = own.getsockname()
        self._zero = time.time() - time.monotonic()

    def now(self) -> int:
        """ms of UNIX time, by the host's monotonic clock since the start."""
        return int((time.monotonic() + self._zero) * 1000)

    def send(self, data: bytes) -> None:
        """Send to all stations.  Raises OSError if the network is unreachable."""
        self._own.sendto(data, self._everyone)

    def receive(self, until: int) -> tuple[int, bytes] | None:
        """The next datagram of another sender and its time in ms; None after ``until``."""
        while True:
            left = max(0, until - self.now()) / 1000
            ready, _, _ = select.select(self._sockets, (), (), left)
            for sock in ready:
                data, where = sock.recvfrom(LARGEST)
                if where != self._name:
                    return self.now(), data
            if not ready and self.now() >= until:
                return None


class Failed(Exception):
    """A case that cannot be continued.

    ``unexpected``: the station sent a message that the specification allows at no time.
    ``overdue``: an allowed message was missing, late or early.  ``cannot_tell``: the application of
    the station did not take the decision that the case needs.
    """

    def __init__(self, kind: Literal["unexpected", "overdue", "cannot_tell"], what: str) -> None:
        super().__init__(what)
        self.kind = kind


class Unwritten:
    """The link of an exchange whose lines are not sent."""

    def exchange(self, lines: Sequence[bytes]) -> list[bytes]:
        """Never called in the cases of a receiver."""
        raise AssertionError("a live station has no lines")


class Live:
    """Plays a script with a live station; the exchange ``x`` predicts its messages.

    Each message must come within ``jitter_ms`` of its time.  ``lines`` gets the transcript.
    ``known`` gets the messages that the station had to send; it may contain those of earlier
    exchanges.  Messages to ``others``, the peers of an earlier failed exchange, are ignored.
    """

    def __init__(
        self,
        x: Exchange,
        air: UdpAir,
        jitter_ms: int,
        lines: list[Line],
        known: list[Object],
        others: Collection[int] = (),
    ) -> None:
        self._x, self._air, self._jitter, self._lines = x, air, jitter_ms, lines
        self._known, self._others = known, others
        self._station = x.wire.values.ids[1]
        self._marks: list[list[int]] | None = None
        """The marks of its last CAM; None if there was none."""
        self._waiting: Received | None = None
        """A message received after the time it was awaited, because the kit itself was late."""

    def play(self, script: Script, lease_ms: int) -> None:
        """Play the script.  Raises Failed."""
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
        """End the station's sessions and acknowledge its messages after a failure.

        Returns True as soon as it has sent nothing for ``quiet_ms`` and its CAMs name no session,
        and False after ``limit_ms``.
        """
        x, period = self._x, self._x.parameters["t_resend"]
        self._others = ()
        self._cancel(x.wire.session(THEIRS))
        begin = quiet_since = self._air.now()
        while (now := self._air.now()) < begin + limit_ms:
            received = self._next(now + period)
            if received is not None:
                quiet_since = received[0]
                self._acknowledge(received[1])
            elif self._marks:
                for session in self._marks:
                    self._cancel(session)
                quiet_since, self._marks = self._air.now(), None
            elif self._marks == [] and self._air.now() >= quiet_since + quiet_ms:
                return True
        return False

    def _cancel(self, session: list[int]) -> None:
        head = {"v": 1, "type": "Cancel", "src": session[0], "dst": self._station}
        self._transmit(head | {"session": session, "seq": 40, "reason": "abort"})
        self._marks = None

    def _acknowledge(self, m: Object) -> None:
        if m.get("seq"):
            head = {"v": 1, "type": "Ack", "src": m.get("dst"), "dst": self._station}
            of = {"type": m.get("type"), "seq": m["seq"]}
            self._transmit(head | {"session": m.get("session"), "seq": 0, "of": of})

    @property
    def _later(self) -> int:
        """The current time; the exchange may be ahead of it, if the station was early."""
        return max(self._x.now, self._air.now())

    # -- the kit's steps

    def _give(self, value: Input, lease_ms: int) -> None:
        """Send a message when no timer of the station is about to expire; await the answer."""
        while (due := self._x.next_due) is not None and due <= self._later + self._jitter:
            self._expiry()
        self._expect_none(self._air.now())
        at = self._later
        self._x.give(number(self._x, value), at=at, lease_ms=lease_ms)
        self._transmit(self._x.unwritten_steps[-1].command["message"])
        self._answered(at + self._jitter)

    def _decided(self, value: Command) -> None:
        """Wait until the station's application accepts."""
        due = self._x.clock.deadline(("decide",))
        received = self._next(due - self._jitter) if due is not None else None
        if received is None:
            raise Failed("cannot_tell", "the station's application did not decide in time")
        at, m = received
        if m.get("type") == "Acceptance" and m.get("accepted") is False:
            raise Failed("cannot_tell", f"the station's application refused: {m.get('reason')}")
        chosen = {"selected": m["selected"]} if _has(TRAJECTORY, m.get("selected")) else None
        self._x.give(number(self._x, value), at=max(self._x.now, at), fields=chosen)
        self._answered(at, received)

    def _wait(self, until: int) -> None:
        """Wait until ``until``, and await the messages of timers that expire meanwhile."""
        while (due := self._x.next_due) is not None and due <= until + self._jitter:
            self._expiry()
        self._expect_none(until)

    def _expire(self, value: Expire) -> None:
        """Wait until this timer has expired."""
        fired: list[int] = []
        while number(self._x, value) not in fired:
            if self._x.clock.deadline(value.timer) is None:
                text = f"the timer {value.timer[0]} does not expire with these parameters"
                raise Failed("cannot_tell", text)
            fired = self._expiry()

    def _expiry(self) -> list[int]:
        """Let the next timer expire, and await its messages.  Returns the inputs."""
        x, due = self._x, self._x.next_due
        assert due is not None
        self._expect_none(due - self._jitter)
        if not self._messages_of(x.clock.due(due)):
            return x.advance(due)
        received = self._next(due + self._jitter)
        # The timers that the station arms at this moment start when it was awake.
        fired = x.advance(due if received is None else max(due, received[0]))
        self._answered(due + self._jitter, received)
        return fired

    # -- the station's messages

    def _answered(self, by: int, received: Received | None = None) -> None:
        """Await the messages of the last step until ``by``; ``received`` is the first, if known."""
        wanted = list(self._x.unwritten_steps[-1].expected.messages)
        while wanted or received is not None:
            received = received or self._next(by)
            if received is None:
                self._overdue(wanted[0], by)
            at, found = received
            match = next((m for m in wanted if self._fits(m, found)), None)
            if match is None:
                self._unexpected(at, found, wanted)
            wanted = [m for m in wanted if m is not match]
            self._known.append(match)
            received = None

    def _fits(self, wanted: Object, found: Object) -> bool:
        """Whether ``found`` is the message ``wanted``; a new Intention may plan any trajectory and
        state an extent."""
        new = all(m is not wanted for m in self._known)
        if new and wanted["type"] == "Intention" and _has(TRAJECTORY, found.get("planned")):
            wanted["planned"] = found["planned"]
            wanted |= {n: found[n] for n in ("length_mm", "width_mm") if _has(EXTENT, found.get(n))}
        return same(wanted, found)

    def _overdue(self, wanted: Object, by: int) -> NoReturn:
        due = f"{transcript.message(wanted)} was due by {by} ms"
        received = self._next(by + 2 * self._x.parameters["t_resend"])
        if received is None:
            raise Failed("overdue", f"{due} and was not received")
        at, found = received
        if self._fits(wanted, found):
            raise Failed("overdue", f"{due} and was received at {at} ms")
        other = transcript.message(found)
        raise Failed("overdue", f"{due}; instead {other} was received at {at} ms")

    def _expect_none(self, until: int) -> None:
        """Raises Failed if the station sends a message before ``until``."""
        if (received := self._next(until)) is not None:
            self._unexpected(*received, [])

    def _unexpected(self, at: int, found: Object, wanted: Sequence[Object]) -> NoReturn:
        what = transcript.message(found)
        if any(same(m, found) for m in self._known):
            text = f"another copy of {what} was received at {at} ms, but none was due"
            raise Failed("overdue", text)
        for timer in self._x.clock.running:
            # A lost CAM or a delayed station is not invalid content.
            if timer[0] != "resend" and any(self._like(m, found) for m in self._messages_of(timer)):
                due = self._x.clock.deadline(timer)
                text = f"{what} was received at {at} ms, but {timer[0]} expires at {due} ms"
                raise Failed("overdue", text)
        if wanted:
            raise Failed("unexpected", first_difference(wanted[0], found).text)
        raise Failed("unexpected", unexpected_message(found))

    def _messages_of(self, timer: Timer | None) -> Sequence[Message]:
        """The messages that are sent when this timer expires."""
        if timer is None:
            return ()
        answer = self._x.oracle.answer(self._x.state, number(self._x, Expire("expire", timer)))
        return () if answer is None else answer.effect.messages

    def _like(self, m: Message, found: Object) -> bool:
        """Whether ``found`` has the type, the session and the reason of the oracle's message."""
        session, reason = self._x.wire.session(m.session), found.get("reason", "none")
        return [m.type, session, m.reason] == [found.get("type"), found.get("session"), reason]

    def _transmit(self, message: Object) -> None:
        self._air.send(to_json(message))
        self._lines.append(Line(self._air.now(), "kit", transcript.message(message)))

    def _next(self, until: int) -> Received | None:
        """The next message of the station other than a CAM; None if there is none by ``until``."""
        while self._waiting is None and (datagram := self._air.receive(until)) is not None:
            at, data = datagram
            m = said_by(self._station, data)
            if m is None:
                continue
            to = m.get("dst")
            if m.get("type") == "CAM":
                self._marks = m["marks"] if _has(MARKS, m.get("marks")) else None
            elif type(to) is not int or to not in self._others:
                self._lines.append(Line(at, "station", transcript.message(m)))
                self._waiting = at, m
        if self._waiting is None or self._waiting[0] > until:
            return None
        received, self._waiting = self._waiting, None
        return received


def said_by(station: int, data: bytes) -> Object | None:
    """The message in a datagram, if it is from this station."""
    try:
        m = from_json(data)
    except ValueError:
        return None
    return m if type(m) is dict and m.get("src") == station else None


def _has(form: TypeAdapter[Any], value: object) -> bool:
    """Whether a value of a message has this form."""
    try:
        form.validate_python(value)
    except ValidationError:
        return False
    return True
