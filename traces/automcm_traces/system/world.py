"""The stations of one run, as the system properties need them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from itertools import takewhile

from automcm_spec.log_format.log import OF_MESSAGE, ApplicationIndication, Receive, Send
from automcm_spec.log_format.reader import Log
from automcm_spec.vocabulary.messages import Fields, session_in
from automcm_traces.system.delivery import named
from automcm_traces.system.log_clocks import Span
from automcm_traces.system.log_merge import Merged
from automcm_traces.system.timeline import Moment, Period, Session, Timeline, key_of, timeline


class World:
    """The timelines of the stations, and the order and time between their events."""

    def __init__(self, merged: Merged, timelines: Mapping[str, Timeline] | None = None) -> None:
        self.merged = merged
        known = timelines or {}
        self.clocks = self.merged.clocks
        self.timelines = {
            log.header.station: known.get(log.file) or timeline(log) for log in self.merged.logs
        }
        self._periods: dict[tuple[int, str, str], dict[Session | None, list[Period]]] = {}

    def log(self, station: int) -> Log:
        """The log of a station that has one."""
        return self.merged.logs[self.merged.place(station)]

    def forged(self, station: int, at: int) -> str:
        """The forged message that an event of a station received, and its place; empty if there is
        none."""
        node = self.merged.place(station), at
        known = node in self.merged.forged
        return f"{named(self.merged, node)}, at {self.merged.where(node)}" if known else ""

    @cached_property
    def _logged(self) -> list[tuple[int, int, Send | Receive, Fields]]:
        """The logged messages but CAMs: of each, its station, the index of its event, the event and
        the message."""
        return [
            (station, at, e, e.message)
            for station, log in zip(self.merged.stations, self.merged.logs, strict=True)
            for at, (_, e) in enumerate(log.events)
            if isinstance(e, OF_MESSAGE) and e.message and e.message["type"] != "CAM"
        ]

    def messages(
        self, type_: str, *events: type[Send] | type[Receive]
    ) -> Iterator[tuple[int, int, Fields, Session, int]]:
        """The logged messages of a type that name a session and a proposal: of each, its station,
        the index of its event, the message, and these two."""
        for station, at, event, m in self._logged:
            if m["type"] == type_ and isinstance(event, events):
                session, proposal = session_in(m.get("session")), m.get("proposal")
                if session and isinstance(proposal, int):
                    yield station, at, m, session, proposal

    @cached_property
    def acceptances(self) -> dict[tuple[int, int, Session, int], int]:
        """The first event that sent an accepting Acceptance, by sender, addressee, session and
        proposal."""
        found: dict[tuple[int, int, Session, int], int] = {}
        for station, at, m, session, proposal in self.messages("Acceptance", Send):
            if m.get("accepted") and isinstance(dst := m.get("dst"), int):
                found.setdefault((station, dst, session, proposal), at)
        return found

    @cached_property
    def leases(self) -> dict[int, dict[tuple[Session, int], int]]:
        """The leases in ms that a station has sent or received, by session and proposal."""
        found: dict[int, dict[tuple[Session, int], int]] = defaultdict(dict)
        for station, _, m, session, proposal in self.messages("Prescription", Send, Receive):
            if isinstance(lease := m.get("lease_ms"), int):
                found[station].setdefault((session, proposal), lease)
        return found

    def periods(
        self, station: int, phase: str, role: str
    ) -> Mapping[Session | None, Sequence[Period]]:
        """``Timeline.periods`` of a station, by session, in order."""
        key = station, phase, role
        if key not in self._periods:
            found = self._periods[key] = {}
            for period in self.timelines[station].periods(phase, role):
                found.setdefault(period.session, []).append(period)
        return self._periods[key]

    def committed(self, station: int, session: Session | None, proposal: int) -> list[Period]:
        """The periods in which a station is committed to a proposal of a session."""
        periods = self.periods(station, "ACTUATING", "receiver").get(session, ())
        return [period for period in periods if period.start.proposal == proposal]

    @cached_property
    def received(self) -> dict[tuple[int, int, str], int]:
        """The first event that received a message, by receiver, sender and ``key_of``."""
        got: dict[tuple[int, int, str], int] = {}
        for station, at, event, m in self._logged:
            src, has_key = m.get("src"), {"seq", "dst", "session"} <= m.keys()
            if isinstance(event, Receive) and has_key and isinstance(src, int):
                got.setdefault((station, src, key_of(m)), at)
        return got

    def elapsed(self, a: int, t_a: int, b: int, t_b: int) -> Span | None:
        """The time in ms from ``t_a`` on the clock of station ``a`` to ``t_b`` on that of station
        ``b``.

        None if their clocks cannot be compared.
        """
        return self.clocks.between(self.merged.place(a), t_a, self.merged.place(b), t_b)

    def before(self, a: int, at_a: int, b: int, at_b: int) -> bool:
        """Whether an event of station ``a`` certainly happened before one of station ``b``."""
        return self.merged.before((self.merged.place(a), at_a), (self.merged.place(b), at_b))

    def slowest(self, src: int, dst: int) -> int:
        """A lower bound in ms on the longest delay of a copy from ``src`` to ``dst``."""
        return self.clocks.slowest(self.merged.place(src), self.merged.place(dst))

    def apart(self, a: Period, b: Period) -> bool | None:
        """Whether two periods of different stations do not overlap; None if unknown."""
        answers = [self._over(a, b), self._over(b, a)]
        if True in answers:
            return True
        return None if None in answers else False

    def _over(self, a: Period, b: Period) -> bool | None:
        """Whether ``a`` ends before ``b`` begins; None if unknown."""
        if a.end is None:
            return False
        if self.before(a.station, a.end.at, b.station, b.start.at):
            return True
        if self.before(b.station, b.start.at, a.station, a.end.at - 1):
            return False
        gap = self.elapsed(a.station, a.end.t_ms, b.station, b.start.t_ms)
        if gap is None or gap.low < 0 <= gap.high:
            return None
        return gap.low >= 0

    def told(self, station: int, m: Moment) -> str:
        """The indications at a moment, such as ``, told fallback(cam_loss)``; empty if there are
        none."""
        names = []
        of_log = self.log(station).events
        events = (of_log[at][1] for at in range(m.at + 1, len(of_log)))
        for event in takewhile(lambda e: not (e.is_input or e.is_cam), events):
            if isinstance(event, ApplicationIndication):
                reason = (event.indication.model_extra or {}).get("reason")
                names.append(event.indication.name + (f"({reason})" if reason else ""))
        return f", told {', '.join(names)}" if names else ""
