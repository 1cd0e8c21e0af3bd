"""The MC service: the facility layer, common to all scenarios (section IV of the paper).

It owns a station, a link, a clock and one application.  It sends and receives CAMs and messages,
sets one alarm for the next deadline, writes the log, and turns the station's indications into calls
of the application interface.  It makes no decisions.
"""

from __future__ import annotations

import random
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from logging import getLogger

from automcm.core.outcome import Received, ReceivedCam
from automcm.core.state import State
from automcm.core.station import Effects, Station
from automcm.encoding.codec import JSON, Codec
from automcm.links.clock import Cancel, Clock
from automcm.links.link import Link
from automcm.service import event_log
from automcm.service.application import (
    HEARD_MS,
    Advertised,
    AgreedManeuver,
    Application,
    Choice,
    CloseWindow,
    Heard,
    Proposal,
    check_methods,
)
from automcm.service.clock_offsets import WINDOW_MS, ClockOffsets, OutOfStep
from automcm.service.statistics import Statistics
from automcm_spec.log_format.writer import LogWriter
from automcm_spec.vocabulary.application import (
    Abort,
    Accept,
    Accepted,
    Choose,
    Close,
    Command,
    Discarded,
    Fallback,
    Finished,
    Indication,
    NoParticipants,
    Propose,
    Refused,
    Undecided,
    Verify,
)
from automcm_spec.vocabulary.messages import (
    BROADCAST,
    MAX_BYTES,
    Advertisement,
    Cam,
    Message,
    MessageError,
    Trajectory,
    to_dict,
)
from automcm_spec.vocabulary.parameters import Parameters, longest_delay

NEIGHBOURS = 256
"""Maximum number of stations whose last CAMs are kept."""

_logger = getLogger(__name__)

Observer = Callable[[State, Effects], None]
"""Called with the state before an input and its effects, after its messages were sent."""


def _attempt(what: Callable[[], object], errors: list[Exception]) -> bool:
    """Call ``what``; append an exception to ``errors``.  Returns whether it succeeded."""
    try:
        what()
    except Exception as error:
        errors.append(error)
        return False
    return True


class McService:
    """One running station.

    ``number`` is the last session number used before, and ``keep_number`` is called with each new
    one before it is sent (END-8).  After a restart of the process, call ``restart``.  ``seed`` is
    the seed of the back-off (END-7) and of the offset of the first CAM.  ``close_window``, such
    as ``all_answered``, is asked after each answer and CAM whether the window may close (ADV-9).
    None: it lasts ``t_advertise``, as in the paper.

    An exception in the application, an observer or ``keep_number`` is raised to the caller (the
    event loop, the simulation) after all other work is done, so that it ends no session.  While
    ``keep_number`` fails, no message is sent.
    """

    def __init__(
        self,
        station_id: int,
        application: Application,
        link: Link,
        clock: Clock,
        *,
        parameters: Parameters | None = None,
        number: int = 0,
        keep_number: Callable[[int], None] = lambda number: None,
        seed: int = 0,
        codec: Codec = JSON,
        log: LogWriter | None = None,
        observers: tuple[Observer, ...] = (),
        out_of_step: OutOfStep = lambda station_id, bounds: None,
        close_window: CloseWindow | None = None,
    ) -> None:
        self.station = Station(
            station_id,
            parameters,
            plan=self._plan,
            number=number,
            seed=seed,
            decode=codec.decode,
        )
        self.application, self.statistics = application, Statistics()
        self.neighbours: OrderedDict[int, Heard] = OrderedDict()
        """The last CAM of each of the ``NEIGHBOURS`` most recently received stations."""
        self._offsets = ClockOffsets(station_id, NEIGHBOURS, self.parameters.known, out_of_step)
        self._link, self._clock, self._codec, self._log = link, clock, codec, log
        self._keep_number, self._observers = keep_number, observers
        self._close_window = close_window
        self._in_time_ms = longest_delay(self.parameters.known)
        self._number = number
        self._time = 0
        self._sent = 0
        self._cam_due = clock.now() + random.Random(seed).randrange(self.parameters.t_cam)
        self._alarm: tuple[int, Cancel] | None = None
        self._awake = 0
        """The time of the last lateness check, in ms."""
        self._late_ms = 0
        """The delay of the last alarm in ms, until it is logged."""
        self._pending: deque[Callable[[], None]] = deque()
        self._busy = False
        self._open = self._closed = self._stopping = False
        self._proposal: Proposal | None = None
        self._before = self.station.state
        check_methods(application)
        application.attach(self)

    @property
    def station_id(self) -> int:
        """The id of its station."""
        return self.station.station_id

    @property
    def parameters(self) -> Parameters:
        """The parameters of its station."""
        return self.station.parameters

    @property
    def state(self) -> State:
        """The present state of its station."""
        return self.station.state

    # -- public operations

    def start(self) -> None:
        """Open the link and begin to send CAMs.  Earlier commands are executed now."""
        self._link.open(self.receive)
        self._open, self._closed = True, False
        self._do(lambda: None)

    def log_to(self, log: LogWriter) -> None:
        """Write to this log from now on.  Call it before ``start``."""
        self._log = log

    def stop(self) -> None:
        """Leave the session, if there is one, by END-1; join and open none from now on.

        The application gets ``fallback`` with the reason ``stop``, and its commands are ignored
        from then on.  CAMs, and the Cancel until it is acknowledged, are sent until ``close``.
        """

        def stop() -> None:
            self._stopping = True
            self._take(self.station.advance(self.now()))
            session = self.state.session
            if session is not None:
                self._take(self.station.command(Abort(session=session), self.now()))
                self.application.fallback(session, "stop")

        self._do(stop)

    def close(self) -> None:
        """Stop at once, as in a crash: nothing more is sent or received, and no timer fires."""
        self._open, self._closed = False, True
        self._pending.clear()
        if self._alarm is not None:
            self._alarm[1]()
            self._alarm = None
        self._link.close()

    def now(self) -> int:
        """The time in ms.  It never decreases, whatever the clock does."""
        self._time = max(self._time, self._clock.now())
        return self._time

    def receive(self, data: bytes, tx: str | None = None) -> int | None:
        """Take bytes from the link; invalid ones are counted and discarded (END-5).

        Returns the sender of the message, or None for invalid bytes.
        """
        src: int | None = None

        def take() -> None:
            nonlocal src
            self.statistics.received_bytes += len(data)
            self.statistics.oversized += len(data) > MAX_BYTES
            now = self.now()
            self._take(self.station.advance(now))  # before the application can act
            effects = self.station.receive(data, now)
            match effects[-1].input:
                case Received(message) | ReceivedCam(message):
                    src = message.src
            self._take(effects, tx, data)

        self._do(take)
        return src

    def rejected(self, reason: str, data: bytes, tx: str | None = None) -> None:
        """Record a datagram that a secured link discarded; the station does not receive it."""

        def record() -> None:
            self.statistics.rejected[reason] += 1
            now = self.now()
            self._take(self.station.advance(now))  # a due timer precedes it in the log
            if self._log is not None:
                event_log.write_rejected(self._log, now, reason, data, tx)

        self._do(record)

    def heard(self) -> tuple[Heard, ...]:
        """As ``Surroundings.heard`` (APP-1)."""
        since = self.now() - HEARD_MS
        return tuple(each for each in self.neighbours.values() if each.received_ms >= since)

    def command(self, command: Command, after_ms: int = 0) -> None:
        """Take a command of the application, now (within a callback: after it) or later."""

        def take() -> None:
            if not self._stopping:
                self._take(self.station.command(command, self.now()))

        if after_ms > 0:
            self._clock.at(self._clock.now() + after_ms, lambda: self.command(command))
        else:
            self._do(take)

    def restart(self) -> None:
        """Forget every session, as after a crash (END-8); the application must drive alone."""

        def restart() -> None:
            session = self.state.session
            self._take(self.station.restart(self.now()))
            if session is not None:
                self.application.fallback(session, "restart")

        self._do(restart)

    # -- one step at a time

    def _do(self, what: Callable[[], None]) -> None:
        """Execute a step and those that the application adds meanwhile; then set the alarm."""
        if self._closed:
            return
        self._pending.append(what)
        if self._busy or not self._open:
            return
        self._busy = True
        if self._alarm is not None:
            self._was_away(self._alarm[0])
        errors: list[Exception] = []
        while self._pending:
            _attempt(self._pending.popleft(), errors)
        self._busy = False
        self._set_alarm()
        if errors:
            raise errors[0]

    def _set_alarm(self) -> None:
        if not self._open:
            return
        deadline = self.station.next_deadline()
        due = self._cam_due if deadline is None else min(deadline, self._cam_due)
        if self._alarm is not None:
            if self._alarm[0] <= due:
                return  # it fires early without effect and is then set again
            self._alarm[1]()
        self._alarm = due, self._clock.at(due, lambda: self._ring(due))

    def _ring(self, due: int) -> None:
        self._alarm = None
        self._time = max(self._time, due)  # the alarm counts as on time even if it fires early
        self._was_away(due)
        self._do(self._on_time)

    def _was_away(self, due: int) -> None:
        """Note the delay of an alarm.

        The timers handle the consequences: they fire before received messages are processed, and
        after ``t_cam_loss`` ACT-2 ends the session.
        """
        now = self.now()
        late = now - max(due, self._awake)  # report one delay once
        self._awake = now
        self.statistics.latest_ms = max(self.statistics.latest_ms, late)
        if late > self._in_time_ms:
            self._late_ms = max(self._late_ms, late)

    def _on_time(self) -> None:
        now = self.now()
        self._take(self.station.advance(now))
        if now >= self._cam_due:
            self._cam_due = max(self._cam_due + self.parameters.t_cam, now + 1)
            self._send_cam(now)

    def _take(self, effects: list[Effects], tx: str | None = None, raw: bytes = b"") -> None:
        """Send, log, count and pass on the effects of a station.

        ``tx`` and ``raw`` belong to the last input, because due timers fire first.
        """
        errors: list[Exception] = []
        steps = []
        last = len(effects) - 1
        for n, effect in enumerate(effects):
            before, self._before = self._before, effect.state
            kept = _attempt(partial(self._keep, effect.state.number), errors)
            messages = effect.messages if kept else ()
            txs = [self._send(message, errors) for message in messages]
            if self._log is not None:
                mine = n == last
                write = partial(
                    event_log.write,
                    self._log,
                    effect._replace(messages=messages),
                    txs,
                    tx=tx if mine else None,
                    raw=raw if mine else b"",
                    late_ms=self._noted(),
                )
                _attempt(write, errors)
            self.statistics.count(effect, before)
            steps.append((before, effect))
        for before, effect in steps:
            for observe in self._observers:
                _attempt(partial(observe, before, effect), errors)
            _attempt(partial(self._notify, effect), errors)
        if errors:
            raise errors[0]

    def _noted(self) -> int | None:
        """The delay since the last record, in ms; None if it is logged already or 0."""
        late, self._late_ms = self._late_ms, 0
        return late or None

    def _keep(self, number: int) -> None:
        if number > self._number:
            self._keep_number(number)
            self._number = number

    # -- sending

    def _send(self, message: Message | Cam, errors: list[Exception]) -> str:
        """Send a message and return its transmission id.

        A message that the codec cannot carry, such as one with too long a trajectory, counts as
        lost; so does one whose sending raises another exception, which is kept in ``errors``.
        """
        self._sent += 1
        tx = f"{self.station_id}:{self._sent}"
        _attempt(partial(self._put, message, tx), errors)
        return tx

    def _put(self, message: Message | Cam, tx: str) -> None:
        try:
            data = self._codec.encode(message)
        except MessageError as error:
            self.statistics.unsendable += 1
            _logger.warning("%s: %s was not sent: %s", self.station_id, message.type, error)
            return
        self.statistics.sent[message.type] += 1
        self.statistics.sent_bytes += len(data)
        self._link.send(data, BROADCAST if isinstance(message, Cam) else message.dst, tx)

    def _send_cam(self, now: int) -> None:
        at = self.application.kinematics(now)
        if at is None:
            return
        cam = Cam(
            src=self.station_id,
            generation_ms=now,
            marks=self.state.marks,
            **asdict(at),
        )
        errors: list[Exception] = []
        tx = self._send(cam, errors)
        if self._log is not None:
            self._log.event("send", now, tx=tx, message=to_dict(cam), late_ms=self._noted())
        if errors:
            raise errors[0]

    # -- the application interface

    def _plan(self, advertisement: Advertisement) -> Trajectory | None:
        """The application's plan; only requested when the station could join (ADV-4)."""
        if self.state.bound or self._stopping:
            return None
        a = advertisement
        return self.application.concerned(Advertised(a.session, a.scenario, a.details, a.planned))

    def _notify(self, effect: Effects) -> None:
        if isinstance(effect.input, ReceivedCam) and effect.input.message.src != self.station_id:
            cam = effect.input.message
            self._remember(cam.generation_ms, Heard.of(cam, effect.now_ms))
        elif isinstance(effect.input, Accept) and effect.rule == "NEG-2":
            p, now = self._proposal, effect.now_ms
            assert p is not None
            selected = effect.input.selected
            self.application.load(
                AgreedManeuver(p.session, "receiver", selected, now + p.hold_ms, now + p.lease_ms)
            )
        for indication in effect.indications:
            self._indicate(indication, effect)
        answers_or_is_heard = ("ADV-5", "END-2", "ACT-5")
        if effect.rule in answers_or_is_heard and self._may_close(self.state):
            self._do(self._close_now)

    def _may_close(self, st: State) -> bool:
        """ADV-9: while advertising, ask ``close_window`` once somebody has answered."""
        if self._close_window is None or st.phase != "ADVERTISING" or not st.recorded:
            return False
        return self._close_window(st.recorded.keys() | st.withdrawn, self.heard())

    def _close_now(self) -> None:
        now = self.now()
        self._take(self.station.advance(now))  # the window may have ended meanwhile
        st = self.state
        if st.session is not None and self._may_close(st):
            self._take(self.station.command(Close(session=st.session), now))

    def _remember(self, generated_ms: int, heard: Heard) -> None:
        src = heard.station_id
        if not self._offsets.heard(src, generated_ms, heard.received_ms):
            heard = replace(heard, in_step=False)
            self.statistics.out_of_step = len(self._offsets.reported)
        self.neighbours[src] = heard
        self.neighbours.move_to_end(src)
        if len(self.neighbours) > NEIGHBOURS:
            gone, _ = self.neighbours.popitem(last=False)
            self._offsets.forget(gone)

    def _in_step(self, station_id: int) -> bool:
        """APP-6; without a CAM lately, nothing is known of its clock."""
        heard = self.neighbours.get(station_id)
        return heard is None or heard.in_step or heard.received_ms < self.now() - WINDOW_MS

    def _indicate(self, indication: Indication, effect: Effects) -> None:
        application, now = self.application, effect.now_ms
        match indication:
            case Refused(detail=command):
                application.refused(command, effect.rule)
            case Undecided():
                application.refused("undecided", effect.rule)
            case Choose(session=session, intentions=intentions):
                planned = {i.src: i.planned for i in intentions if self._in_step(i.src)}
                application.choose(Choice(session, 1, planned, heard=self.heard()))
            case Propose(session=session, proposal=proposal, reason=reason):
                target = effect.state.target
                application.choose(Choice(session, proposal, {}, target, reason, self.heard()))
            case Verify(session=session, prescription=m):
                self._proposal = Proposal(session, m.proposal, m.prescribed, m.hold_ms, m.lease_ms)
                if self._in_step(session[0]):
                    application.verify(self._proposal)
                else:
                    self.command(self._proposal.refuse())
            case Accepted(session=session, selected=selected):
                until = now + indication.lease_left_ms
                application.load(AgreedManeuver(session, "prescriber", selected, now, until))
            case Fallback(session=session, reason=reason):
                application.fallback(session, reason)
            case NoParticipants(session=session):
                application.fallback(session, "no_participants")
            case Finished(session=session):
                application.finished(session)
            case Discarded():
                pass
