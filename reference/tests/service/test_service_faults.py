"""Whatever is wrong with messages, codec or application, the service goes on."""

from __future__ import annotations

import base64
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from service_stage import Jumpy, Noted, alone, cam, pair

from automcm.encoding.codec import JSON
from automcm.links.simulated_radio import Channel
from automcm.service import event_log
from automcm.service.application import Advertised, Proposal
from automcm.service.service import NEIGHBOURS
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import LANE_CHANGE, Straight
from automcm_spec.log_format.reader import read
from automcm_spec.log_format.writer import LogWriter
from automcm_spec.vocabulary.application import Abort, Request
from automcm_spec.vocabulary.messages import MAX_BYTES, Advertisement, Fin, Trajectory, encode
from automcm_spec.vocabulary.parameters import Parameters, in_header
from automcm_traces.explain.explain import verdict_of

ABOUT: dict[str, Any] = {"run": "r", "station": 1, "implementation": "i", "version": "1"}
"""A log's header."""


def test_mem_1_the_neighbours_kept_are_those_heard_last_and_not_oneself() -> None:
    service, wire, _ = alone()
    for src in range(2, NEIGHBOURS + 12):
        wire.receive(cam(src, 1), None)
    wire.receive(cam(12, 2), None)
    wire.receive(cam(1, 3), None)
    assert len(service.neighbours) == NEIGHBOURS
    assert list(service.neighbours)[-2:] == [NEIGHBOURS + 11, 12]
    assert 11 not in service.neighbours and 1 not in service.neighbours
    assert service._offsets._cams.keys() == set(service.neighbours)


def test_end_5_what_is_wrong_is_counted_by_what_is_wrong_with_it() -> None:
    service, wire, _ = alone()
    fin: dict[str, Any] = {"src": 2, "session": (2, 1), "seq": 1}
    heard = [
        b"\x00\xff",
        b"x" * (MAX_BYTES + 1),
        encode(Fin(**fin, dst=7)),
        encode(Fin(src=1, dst=1, session=(2, 1), seq=1)),
        encode(Fin(**fin, dst=1)),
        encode(Fin(**fin, dst=1)),
        cam(3, 5),
    ]
    sources = [wire.receive(data, None) for data in heard]
    assert sources == [None, None, 2, 1, 2, 2, 3]
    s = service.statistics
    assert (s.malformed, s.oversized, s.elsewhere, s.broken, s.foreign) == (2, 1, 1, 1, 2)
    assert s.received == {"Fin": 4, "CAM": 1} and s.received_bytes == sum(map(len, heard))
    assert s.rules == {"END-5": 3, "MSG-1": 1, "END-3": 2, "ACT-5": 1}
    assert s.sent == {"Ack": 2}  # each copy (END-3)
    assert s.as_dict()["rules"] == dict(sorted(s.rules.items()))


def test_end_5_copies_within_the_session_are_counted_as_repeated() -> None:
    _, _, simulation = pair()
    simulation.radio.channel = Channel(duplicate=1.0, delay_ms=(0, 0))
    simulation.run(9000)
    assert simulation.services[2].statistics.repeated > 20  # of 21 Advertisements, for a start


def test_what_the_codec_cannot_carry_is_as_if_lost_and_counted() -> None:
    application = Noted()
    service, wire, clock = alone(application)
    huge = Trajectory(t0=0, points=((0, 0, 0),) * 20_000)
    service.command(Request(scenario="x", details={}, planned=huge))
    clock.run(3000)
    assert wire.of("Advertisement") == [] and service.statistics.unsendable == 21
    assert application.calls == [("fallback", (1, 1), "no_participants")]


def test_an_application_that_raises_stops_no_session() -> None:
    class Faulty(Noted):
        def verify(self, proposal: Proposal) -> None:
            raise RuntimeError("a bug")

    simulation = Simulation(channel=Channel(delay_ms=(0, 0)))
    simulation.add(1, Noted(concerned_by_all=False))
    simulation.add(2, Faulty())
    simulation.request(1, 0)
    for _ in range(3):  # rounds
        with pytest.raises(RuntimeError, match="a bug"):
            simulation.clock.run(20_000)
    simulation.clock.run(20_000)
    assert {service.state.phase for service in simulation.services.values()} == {"STANDALONE"}
    assert simulation.services[2].statistics.rules["NEG-3"] == 3  # no verdict in time


def advertisement(src: int, number: int = 1) -> bytes:
    return encode(Advertisement(src=src, session=(src, number), seq=1, scenario="x", details={}))


def test_what_was_due_happens_even_if_the_application_raises_when_asked_to_join() -> None:
    class Faulty(Noted):
        def concerned(self, advertised: Advertised) -> Trajectory | None:
            raise RuntimeError("a bug")

    application = Faulty()
    service, wire, clock = alone(application, Jumpy())
    service.command(LANE_CHANGE)
    clock.time = 2100  # the window closes just before the Advertisement is read
    with pytest.raises(RuntimeError, match="a bug"):
        wire.receive(advertisement(2), None)
    assert application.calls == [("fallback", (1, 1), "no_participants")]
    assert service.statistics.rules["PRE-1"] == 1 and len(clock.alarms) == 1


def test_an_exception_keeps_nobody_else_from_being_told() -> None:
    application = Noted()

    def breaks(before: object, effects: object) -> None:
        raise RuntimeError("an observer's bug")

    seen: list[str] = []
    observers = breaks, lambda before, effects: seen.append(effects.rule)
    service, _, _ = alone(application, observers=observers)
    with pytest.raises(RuntimeError, match="an observer's bug"):
        service.command(Abort(session=(1, 1)))
    assert (application.calls, seen) == ([("refused", "abort", "CMD-1")], ["CMD-1"])


def test_end_8_while_a_number_cannot_be_kept_nothing_goes_on_the_air() -> None:
    broken = True

    def keep(number: int) -> None:
        if broken:
            raise OSError("disk full")

    service, wire, clock = alone(keep_number=keep)
    with pytest.raises(OSError, match="disk full"):
        service.command(LANE_CHANGE)
    for _ in range(5):
        with pytest.raises(OSError, match="disk full"):
            clock.run(clock.now() + 100)
    assert wire.of("Advertisement") == []
    broken = False
    clock.run(clock.now() + 1000)
    assert len(wire.of("Advertisement")) > 5


def test_a_log_holds_cams_raw_bytes_and_the_transmission_of_each_input(tmp_path: Path) -> None:
    simulation = Simulation(logs=tmp_path)
    simulation.add(1, Straight())
    simulation.add(2, Straight())
    simulation.request(1, 100)
    simulation.clock.at(300, lambda: simulation.services[2].receive(b"rubbish", "9:9"))
    simulation.run(3000)
    events = [event for _, event in read(tmp_path / "2.ndjson").events]
    sent = [e for e in events if e.ev == "send"]
    assert Counter(e.message["type"] for e in sent)["CAM"] >= 29
    (raw,) = [e for e in events if e.ev == "receive" and e.raw]
    assert base64.b64decode(raw.raw or "") == b"rubbish" and raw.tx == "9:9"
    received = [e for e in events if e.ev == "receive"]
    assert all(e.tx for e in received)
    by_1 = {e.tx: e.message for _, e in read(tmp_path / "1.ndjson").events if e.ev == "send"}
    assert all(by_1[e.tx] == e.message for e in received if e.message)


class Broken(LogWriter):
    """Refuses every event from some time on."""

    from_ms = 0

    def event(self, ev: str, t_ms: int, /, **fields: object) -> int:
        if t_ms >= self.from_ms:
            raise OSError("no room")
        return super().event(ev, t_ms, **fields)


def test_a_log_that_raises_keeps_no_message_from_the_air(tmp_path: Path) -> None:
    log = Broken(tmp_path / "log", **ABOUT)
    application = Noted()
    service, wire, clock = alone(application, log=log)
    with pytest.raises(OSError, match="no room"):
        service.command(LANE_CHANGE)
    assert len(wire.of("Advertisement")) == 1
    for _ in range(100):
        try:
            clock.run(5000)
            break
        except OSError:
            pass
    assert len(wire.of("Advertisement")) == 21 and len(wire.of("CAM")) >= 49
    assert application.calls == [("fallback", (1, 1), "no_participants")]


@pytest.mark.parametrize("victim", [1, 2])
@pytest.mark.parametrize("at", [50, 500, 2250, 2500, 3000, 20_000])
def test_end_1_a_service_that_stops_leaves_and_tells_everybody(victim: int, at: int) -> None:
    """In whatever phase it is: its peers get a Cancel and ack it, its application a fallback."""
    one, two, simulation = pair()
    stopped = simulation.services[victim]
    simulation.run(at)
    session, recorded = stopped.state.session, stopped.state.recorded
    role = stopped.state.role
    peers = [stopped.state.peer] if role == "receiver" or stopped.state.target else recorded
    stopped.stop()
    simulation.run(at + 500)
    assert stopped.state.phase == "STANDALONE" and not stopped.state.outbox
    assert stopped.statistics.sent["Cancel"] == len(peers if session else [])
    assert (("fallback", session, "stop") in (one, two)[victim - 1].calls) == bool(session)
    before = stopped.statistics.sent["CAM"]
    (one, two)[victim - 1].calls.clear()
    stopped.command(LANE_CHANGE)
    simulation.services[3 - victim].command(LANE_CHANGE)
    simulation.run(at + 1500)
    assert stopped.state.phase == "STANDALONE"  # it joins nothing, and begins nothing
    assert stopped.statistics.sent["CAM"] > before + 8  # and is still there
    assert (one, two)[victim - 1].calls == []


def test_of_an_absence_the_log_tells_once(tmp_path: Path) -> None:
    log = LogWriter(tmp_path / "log", **ABOUT)
    service, wire, clock = alone(clock=Jumpy(), log=log)
    first = min(due for due, _ in clock.alarms)
    for late in (0, service.parameters.t_resend // 2, 2000):
        clock.time = max(clock.time, first) + late
        wire.receive(cam(2, clock.time), None)
        clock.ring(clock.time)
    log.end("clean")
    told = [e.late_ms for _, e in read(tmp_path / "log").events]
    assert [late for late in told if late] == [service.statistics.latest_ms]
    assert service.statistics.latest_ms > 1500


def test_a_message_that_cannot_be_encoded_is_as_if_lost_and_its_step_is_logged(
    tmp_path: Path,
) -> None:
    class Scarce:
        """Out of memory for the first of each kind of message."""

        name = "json"
        seen: set[str] = set()  # noqa: RUF012

        def encode(self, message: Any) -> bytes:
            if message.type not in self.seen:
                self.seen.add(message.type)
                raise MemoryError
            return encode(message)

        def decode(self, data: bytes) -> Any:
            return JSON.decode(data)

    log = LogWriter(
        tmp_path / "log",
        **ABOUT,
        parameters=in_header(Parameters().known),
        complete=event_log.COMPLETE,
    )
    service, wire, clock = alone(codec=Scarce(), log=log)
    with pytest.raises(MemoryError):
        service.command(LANE_CHANGE)
    with pytest.raises(MemoryError):  # the first CAM
        clock.run(5000)
    clock.run(5000)
    log.end("clean")
    assert len(wire.of("Advertisement")) == 20
    assert verdict_of(tmp_path / "log").verdict == "allowed"
    events = [e for _, e in read(tmp_path / "log").events if e.ev == "send"]
    assert len(events) == service._sent
