"""Writes a behaviour of a closed model as the logs that its stations would have written.

A behaviour has small ids, messages without content, and no times. A log has real ids, content,
seqs, transmissions and clocks. The effects of each station come from the behaviour; only values
that the specification leaves open are made up here:

* ids are the model's ids times 1001 (1001, 2002, …); session numbers stay;
* a message is received as its latest transmission; a CAM that is newer although that transmission
  has arrived before is forged, with the largest generation time (``Forger.tla``);
* a step takes ``STEP_MS``. The header states no durations, so the deadline of a timer is the time
  at which the behaviour lets it expire, or far in the future. Only the lease has a duration on the
  wire: if two stations let it run for different times, the clock of one runs ahead (times of
  different stations are not compared). A timed model provides its own times and deadlines;
* a CAM is sent whenever its marks change. No station receives it, unless the model says so;
* the content and seq of a message that an attacker has forged. No log has sent it.
"""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from automcm_spec.log_format.log import EVENT_KINDS
from automcm_spec.log_format.writer import LogWriter
from automcm_spec.vocabulary import station as spec
from automcm_spec.vocabulary import wire_forms
from automcm_spec.vocabulary.conditions import EMPTY
from automcm_spec.vocabulary.json_forms import canonical
from automcm_spec.vocabulary.messages import LIMIT
from automcm_traces.checker.track import REASONS

Json = Any
START_MS, STEP_MS, FAR_MS, LEASE_MS = 100, 20, 60_000, 20_000
LEASE: spec.Timer = ("lease",)
Proposal = tuple[spec.Session, int]
"""A session, and the number of the proposal."""
PLANNED = {"t0": 0, "points": [[0, 0, 0], [1000, 8333, 0]]}
ADVERTISED = {"scenario": "lane_change", "details": {"lane": 2}}
FORGED = 1000
"""The seqs of forged messages, and the numbers of their transmissions, are above this one."""


class BehaviourError(Exception):
    """A behaviour that cannot be written as a log; the text names the step."""


class StepEffects(NamedTuple):
    """The outcome of a step, and the sessions that the station's CAMs name after it. All with the
    model's ids."""

    outcome: spec.Outcome
    marks: frozenset[spec.Session]


@dataclass(frozen=True, slots=True)
class BehaviourStep:
    """One step of a station: the state before it, the input and the effects.

    ``at_ms`` and ``deadlines`` (on the same clock) are those of a timed model; ``behind_ms`` is the
    lag of each station's clock. ``cams`` are stations that send a CAM before the step.
    """

    station: int
    before: spec.State
    input: spec.Input | None
    effects: StepEffects
    at_ms: int | None = None
    behind_ms: Mapping[int, int] = field(default_factory=dict)
    deadlines: Mapping[spec.Timer, int] | None = None
    cams: tuple[int, ...] = ()


def real_id(station: int) -> int:
    """The id in the log for a station of a model."""
    return station * 1001


def logs(
    run: str,
    story: Sequence[BehaviourStep],
    stations: Sequence[int],
    parameters: Mapping[str, int],
    lease_ms: int | None = None,
    *,
    attacked: bool = False,
) -> dict[int, bytes]:
    """The log of each station, by its real id.

    ``parameters`` goes into each header. ``lease_ms`` is the lease of a timed model. Raises
    BehaviourError if a message is received that nobody has sent, unless an attacker has forged it
    (``attacked``).
    """
    builder = _LogBuilder(story, stations, lease_ms, attacked)
    for n, happening in enumerate(story):
        builder.add_step(n, happening)
    return {real_id(s): builder.written(s, run, parameters) for s in stations}


@dataclass
class _Lease:
    """A lease at a station: the steps at which it was armed and ended."""

    armed: int
    over: int
    expired: bool = False


@dataclass
class _Station:
    """The log of one station so far."""

    events: list[tuple[str, int, dict[str, Json]]] = field(default_factory=list)
    transmissions: int = 0
    cams: set[str] = field(default_factory=set)
    """The transmissions of the CAMs it has received."""
    marks: frozenset[spec.Session] = EMPTY
    open: dict[spec.Timer, int] = field(default_factory=dict)
    """For each armed timer, the index of its arm event in ``events``."""


Marked = tuple[str, int, frozenset[spec.Session]]
"""A CAM: ``cam``, its sender and its marks."""


class _LogBuilder:
    """Converts steps to events."""

    def __init__(
        self,
        story: Sequence[BehaviourStep],
        stations: Sequence[int],
        lease_ms: int | None,
        attacked: bool,
    ) -> None:
        self._attacked = attacked
        self._forgeries = 0
        self._stations = {s: _Station() for s in stations}
        self._seqs: Counter[tuple[int, spec.Session]] = Counter()
        self._sent: dict[tuple[int, str, int, spec.Session, int], dict[str, Json]] = {}
        self._air: dict[spec.Message | Marked, tuple[str, dict[str, Json]]] = {}
        self._lease, self._times = _times(story, stations, lease_ms)
        self._last = max((t[-1] for t in self._times.values() if t), default=0)

    # -- steps

    def add_step(self, n: int, h: BehaviourStep) -> None:
        for sender in h.cams:
            self._cam(sender, self._times[sender][n])
        if not h.station:
            return
        me, now = self._stations[h.station], self._times[h.station][n]
        outcome = h.effects.outcome
        more = {"rule": outcome.rule, "phase": outcome.st.phase, "role": outcome.st.role}
        received_message = self._input(n, h, now, more)
        for m in sorted(outcome.out, key=lambda m: (m.type == "Ack", canonical(m))):
            self._send(h, m, now, received_message)
        for timer in sorted(outcome.stop, key=canonical):
            me.open.pop(timer, None)
            named = self._timer(h.station, timer)
            me.events.append(("timer", now, {"op": "stop", "timer": named}))
        for timer in sorted(outcome.arm, key=canonical):
            self._arm(h, timer, now)
        if outcome.told != ("nothing",):
            indication = self._indication(h, received_message)
            me.events.append(("indication", now, {"indication": indication}))
        if h.effects.marks != me.marks:
            me.marks = h.effects.marks
            if h.at_ms is None:
                self._cam(h.station, now)

    def _input(self, n: int, h: BehaviourStep, now: int, more: dict[str, Json]) -> dict[str, Json]:
        """Write the input; returns the received message, or an empty dict if there is none."""
        me = self._stations[h.station]
        received_message: dict[str, Json] = {}
        match h.input:
            case spec.Receive() | spec.Cam() as i:
                key = plain(i.message) if isinstance(i, spec.Receive) else ("cam", i.src, i.marks)
                if key not in self._air and self._attacked:
                    self._air[key] = self._forged(h, i, now)
                if key not in self._air:
                    raise BehaviourError(f"step {n + 1}: received but never sent: {canonical(key)}")
                tx, received_message = self._air[key]
                fields: dict[str, Json] = {"tx": tx, "message": received_message}
                if isinstance(i, spec.Cam):
                    if i.newer and tx in me.cams:
                        received_message = received_message | {"generation_ms": LIMIT}
                        fields = {"message": received_message}
                    me.cams.add(tx)
                if (
                    isinstance(i, spec.Receive)
                    and i.message.type == "Advertisement"
                    and i.concerned
                ):
                    fields["planned"] = PLANNED
                me.events.append(("receive", now, fields | more))
            case spec.Command() as command:
                me.events.append(("command", now, {"command": self._command(command)} | more))
            case spec.Expire(timer=timer):
                named = self._timer(h.station, timer)
                armed = me.open.pop(timer, None)
                if armed is not None and h.at_ms is None:
                    me.events[armed][2]["deadline"] = now
                me.events.append(("timer", now, {"op": "expire", "timer": named} | more))
            case _:
                me.events.append(("restart", now, more))
        self._forget(h)
        return received_message

    def _forged(
        self, h: BehaviourStep, i: spec.Receive | spec.Cam, now: int
    ) -> tuple[str, dict[str, Json]]:
        """The transmission and the message of an attacker."""
        self._forgeries += 1
        number = FORGED + self._forgeries
        tx = f"{real_id(i.src if isinstance(i, spec.Cam) else i.message.src)}:{number}"
        if isinstance(i, spec.Cam):
            return tx, _cam_message(i.src, now, i.marks)
        m = i.message

        def content(name: str) -> Json:
            if name == "reason":
                as_sent = "abort" if m.type == "Cancel" else "unsafe"
                return as_sent if m.reason == "as_sent" else m.reason
            if name == "of":
                type_, seq = m.of
                sent = self._sent[h.station, type_, m.src, m.session, seq]
                return {"type": type_, "seq": sent["seq"]}
            return self._given(name, m.session, m.proposal)

        return tx, wire_forms.message(NAMES, m, number if m.seq else 0, content)

    def _given(self, name: str, session: spec.Session, proposal: int) -> Json:
        """The content that an application gives."""
        lease_ms = self._lease.get((session, proposal), LEASE_MS)
        plain = ADVERTISED | {"planned": PLANNED, "hold_ms": 2000, "lease_ms": lease_ms}
        trajectory = {"t0": 0, "points": [[0, 0, 0], [1000, 6333 - 500 * proposal, 0]]}
        return plain.get(name, trajectory)

    def _forget(self, h: BehaviourStep) -> None:
        """A station that forgets sessions also forgets their seqs (ADV-8, END-8)."""
        match h.input:
            case spec.Expire(timer=(_, int(p))):
                gone = {p}
            case spec.Restart():
                gone = {session[0] for _, session in self._seqs}
            case _:
                return
        for station, session in list(self._seqs):
            if station == h.station and session[0] in gone:
                del self._seqs[station, session]

    def _command(self, i: spec.Command) -> dict[str, Json]:
        return wire_forms.command(NAMES, i, lambda name: self._given(name, i.session, i.proposal))

    # -- effects

    def _send(
        self, h: BehaviourStep, m: spec.Message, now: int, received_message: dict[str, Json]
    ) -> None:
        key = m.src, m.type, m.dst, m.session, m.seq
        entry = spec.Entry(m.type, m.dst, m.session, m.seq, m.accepted)
        again = m.type == "Advertisement" and isinstance(h.input, spec.Expire)
        if m.seq and key in self._sent and (again or entry in h.before.outbox):
            message = self._sent[key]
        else:
            seq = 0
            if m.seq:
                self._seqs[m.src, m.session] += 1
                seq = self._seqs[m.src, m.session]
            given = self._command(h.input) if isinstance(h.input, spec.Command) else {}
            given |= {"planned": PLANNED, "reason": m.reason}
            given["of"] = {name: received_message.get(name) for name in ("type", "seq")}
            message = wire_forms.message(NAMES, m, seq, given.__getitem__)
            self._sent[key] = message
        self._transmit(h.station, now, plain(m), message)

    def _cam(self, station: int, now: int) -> None:
        marks = self._stations[station].marks
        self._transmit(station, now, ("cam", station, marks), _cam_message(station, now, marks))

    def _transmit(
        self, station: int, now: int, key: spec.Message | Marked, message: dict[str, Json]
    ) -> None:
        me = self._stations[station]
        me.transmissions += 1
        tx = f"{real_id(station)}:{me.transmissions}"
        self._air[key] = tx, message
        me.events.append(("send", now, {"tx": tx, "message": message}))

    def _arm(self, h: BehaviourStep, timer: spec.Timer, now: int) -> None:
        me = self._stations[h.station]
        named = self._timer(h.station, timer)
        deadline = self._last + FAR_MS
        if h.deadlines is not None:
            deadline = h.deadlines[timer]
        elif timer == LEASE:
            after = h.effects.outcome.st
            deadline = now + self._lease[after.session, after.proposal]
        fields = {"op": "arm", "timer": named, "deadline": deadline}
        if timer != LEASE:
            me.open[timer] = len(me.events)
        me.events.append(("timer", now, fields))

    def _timer(self, station: int, timer: spec.Timer) -> dict[str, Json]:
        match timer:
            case (name, int(p)):
                return {"name": name, "station": real_id(p)}
            case (name, spec.Entry(type=type_, to=to, session=session, seq=k)):
                about: dict[str, Json] = {"type": type_} | ({"to": real_id(to)} if to else {})
                seq = self._sent[station, type_, to, session, k]["seq"]
                about |= {"session": NAMES.session(session), "seq": seq}
                return {"name": name, "message": about}
        return {"name": timer[0]}

    def _indication(self, h: BehaviourStep, received_message: dict[str, Json]) -> dict[str, Json]:
        name, *about = h.effects.outcome.told
        indication: dict[str, Json] = {"name": name, "rule": h.effects.outcome.rule}
        after = h.effects.outcome.st
        session = h.before.session if after.session == (0, 0) else after.session
        if session != (0, 0):
            indication["session"] = NAMES.session(session)
        if name in ("verify", "accepted", "propose"):
            indication["proposal"] = after.proposal + (name == "propose")
        if about:
            indication["reason"] = received_message["reason"] if about[0] == "as_sent" else about[0]
        return indication

    # -- the end

    def written(self, station: int, run: str, parameters: Mapping[str, int]) -> bytes:
        """The log of a station as bytes."""
        stream = io.BytesIO()
        with LogWriter(
            stream,
            run=run,
            station=real_id(station),
            implementation="automcm.story",
            version="1",
            parameters=parameters,
            complete=EVENT_KINDS,
        ) as log:
            for ev, t_ms, fields in self._stations[station].events:
                log.event(ev, t_ms, **fields)
        return stream.getvalue()


def _times(
    story: Sequence[BehaviourStep], stations: Sequence[int], lease_ms: int | None
) -> tuple[dict[Proposal, int], dict[int, list[int]]]:
    """The length of each proposal's lease, and for each station the time of each step."""
    base = [START_MS + STEP_MS * n if h.at_ms is None else h.at_ms for n, h in enumerate(story)]
    leases = {s: _leases(s, story) for s in stations}
    lengths: dict[Proposal, int] = {}
    for ran in leases.values():
        for key, lease in ran:
            natural = base[lease.over] - base[lease.armed] + (not lease.expired)  # due later
            lengths[key] = max(lengths.get(key, 0), natural)
    for key in lengths:
        if lease_ms is not None:
            lengths[key] = lease_ms
        elif not any(k == key and lease.expired for ran in leases.values() for k, lease in ran):
            lengths[key] = LEASE_MS + lengths[key] // 1000 * 1000
    times = {}
    for s in stations:
        ahead, own = 0, []
        waits = {lease.over: (key, lease) for key, lease in leases[s] if lease.expired}
        for n, t_ms in enumerate(base):
            if n in waits and lease_ms is None:
                key, lease = waits[n]
                ahead += lengths[key] - (base[n] - base[lease.armed])
            own.append(t_ms + ahead - story[n].behind_ms.get(s, 0))
        times[s] = own
    return lengths, times


def _leases(station: int, story: Sequence[BehaviourStep]) -> list[tuple[Proposal, _Lease]]:
    """The leases at a station, each with its session and proposal."""
    found: list[tuple[Proposal, _Lease]] = []
    running: _Lease | None = None
    for n, h in enumerate(story):
        if h.station != station:
            continue
        expired = h.input == spec.Expire("expire", LEASE)
        if running and (expired or LEASE in h.effects.outcome.stop):
            running.over, running.expired = n, expired
            running = None
        if LEASE in h.effects.outcome.arm:
            running = _Lease(n, len(story) - 1)
            found.append(((h.effects.outcome.st.session, h.effects.outcome.st.proposal), running))
    return found


def _cam_message(station: int, now: int, marks: frozenset[spec.Session]) -> dict[str, Json]:
    return wire_forms.cam(NAMES, station, marks, now, now * 8)


class _Names:
    def station(self, station: int) -> int:
        return real_id(station)

    def session(self, session: spec.Session) -> list[int]:
        return [real_id(session[0]), session[1]]


NAMES = _Names()


def plain(m: spec.Message) -> spec.Message:
    """A message as the radio of the model represents it (Plain in Network.tla)."""
    is_named = m.reason in REASONS
    return m if is_named else m._replace(reason="as_sent")
