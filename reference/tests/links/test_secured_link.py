"""Sessions of two services on secured links, alone and under attack."""

from __future__ import annotations

import asyncio
import base64
import json
import random
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from automcm_stage import cam, cancel, fin
from security_stage import (
    DAY,
    NOW,
    OTHER_AUTHORITY,
    SecuredSimulation,
    credentials,
    key,
    new_verifier,
    seal,
)
from service_stage import Jumpy, Noted, Wire, alone

from automcm.encoding.codec import FRAME_BYTES, JSON
from automcm.links.link import LinkError, Receiver
from automcm.links.secured import SecuredLink
from automcm.links.simulated_radio import Channel
from automcm.security import cose, envelope
from automcm.security.signer import PseudonymError, Signer
from automcm.service.application import AgreedManeuver
from automcm.service.secured_service import LOGGED_PER_SECOND, change_credentials
from automcm.service.station_process import _free
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import LANE_CHANGE
from automcm_spec.log_format.reader import read
from automcm_spec.log_format.writer import LogWriter
from automcm_spec.vocabulary.messages import encode
from automcm_traces.explain.explain import explain

UNTIL = 9000
CHANNEL = Channel(delay_ms=(5, 5))


def started(kind: Callable[..., Simulation], **more: Any) -> Any:
    """A prescriber (1) and a receiver (2), whose session begins at 2,000 ms."""
    simulation = kind(**more)
    simulation.add(1, Noted(concerned_by_all=False))
    simulation.add(2, Noted())
    simulation.request(1, 2000)
    return simulation


def test_a_session_on_secured_links_completes_like_another(tmp_path: Path) -> None:
    rows = []
    for kind in (Simulation, SecuredSimulation):
        simulation = started(kind, channel=CHANNEL, logs=tmp_path / kind.__name__)
        simulation.run(UNTIL)
        assert simulation.services[2].application.calls[-1] == ("finished", (1, 1))
        rows.append([events(tmp_path / kind.__name__ / f"{n}.ndjson") for n in (1, 2)])
        assert not any(s.statistics.rejected for s in simulation.services.values())
    assert rows[0] == rows[1]


@pytest.mark.parametrize("seed", range(5))
def test_sessions_end_on_lossy_secured_links(seed: int) -> None:
    channel = Channel(loss=0.3, duplicate=0.2, reorder=0.2, delay_ms=(2, 24))
    simulation = started(SecuredSimulation, seed=seed, channel=channel)
    simulation.run(UNTIL)
    receiver = simulation.services[2]
    assert receiver.application.calls[-1] == ("finished", (1, 1))
    assert set(receiver.statistics.rejected) <= {"replayed", "unknown_signer"}


def events(path: Path) -> list[dict[str, Any]]:
    """The events of a log without the rejected datagrams and without their numbers."""
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    return [
        {name: value for name, value in line.items() if name != "seq"}
        for line in lines
        if line["rec"] == "event" and "rejected" not in line
    ]


Attack = Callable[[SecuredSimulation, random.Random], bytes]

STRANGER = credentials(2, authority=OTHER_AUTHORITY, private=66, not_before=0, not_after=DAY)
INSIDER = credentials(666, not_before=0, not_after=DAY)
OWN = credentials(1, not_before=0, not_after=DAY)


def lie(of: int, now: int, rng: random.Random) -> Any:
    """A message that would end the session, or keep it, if it were of station ``of``."""
    to = 3 - of
    return rng.choice(
        [
            cancel(src=of, session=(1, 1), dst=to),
            fin(session=(1, 1), src=1, dst=2),
            cam(of, now),
            cam(of, now + 90, (1, 1)),
        ]
    )


def forged(simulation: SecuredSimulation, rng: random.Random) -> bytes:
    """By a stranger: with a certificate of another authority, or under a station's digest."""
    now, of = simulation.clock.now(), rng.choice((1, 2))
    message = lie(of, now, rng)
    if rng.random() < 0.5:
        return seal(STRANGER, message, now)
    header = {cose.KID: simulation.credentials[of].certificate.digest}
    payload = cose.encode([now, encode(message)])
    return cose.sign(key(66), header, payload, envelope.CONTEXT + b"json")


def insider(simulation: SecuredSimulation, rng: random.Random) -> bytes:
    """By another station with a certificate, under the id of one of the two."""
    now = simulation.clock.now()
    return seal(INSIDER, lie(rng.choice((1, 2)), now, rng), now, whole=rng.random() < 0.5)


def changed(simulation: SecuredSimulation, rng: random.Random) -> bytes:
    """One of the last envelopes with a changed byte."""
    data = rng.choice(simulation.air[-20:])[1]
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ rng.randrange(1, 256)]) + data[at + 1 :]


def replayed(simulation: SecuredSimulation, rng: random.Random) -> bytes:
    """An envelope that has arrived already and may still be fresh."""
    before = [data for at, data in simulation.air if 5 < simulation.clock.now() - at < 2000]
    return rng.choice(before)


def stale(simulation: SecuredSimulation, rng: random.Random) -> bytes:
    """An envelope from before the window."""
    before = [data for at, data in simulation.air if simulation.clock.now() - at > 2100]
    return rng.choice(before)


ATTACKS: tuple[Attack, ...] = (forged, insider, changed, replayed, stale)
EACH = 150


def attacked(seed: int, logs: Path) -> Counter[str]:
    """Compare a session under EACH attacks with one without: the reasons of all rejections."""
    baseline = started(SecuredSimulation, seed=seed, channel=CHANNEL, logs=logs / "baseline")
    baseline.run(UNTIL)
    simulation = started(SecuredSimulation, seed=seed, channel=CHANNEL, logs=logs / "attacked")
    attacker, rng = simulation.radio.link(666), random.Random(seed)
    for n in range(EACH):
        attack = ATTACKS[n % len(ATTACKS)]

        def inject(attack: Attack = attack) -> None:
            attacker.send(attack(simulation, rng), 0, "666:1")

        simulation.clock.at(rng.randrange(2300, 6800), inject)
    simulation.run(UNTIL)
    for n in (1, 2):
        name = f"{n}.ndjson"
        assert events(logs / "attacked" / name) == events(logs / "baseline" / name)
        assert explain(read(logs / "attacked" / name)).verdict == "allowed"
    assert simulation.services[2].application.calls[-1] == ("finished", (1, 1))
    return sum((s.statistics.rejected for s in simulation.services.values()), Counter())


def test_nothing_forged_changed_replayed_or_stale_takes_effect(tmp_path: Path) -> None:
    reasons = attacked(0, tmp_path)
    assert sum(reasons.values()) == 2 * EACH
    wanted = {"malformed", "stale", "replayed", "unknown_authority", "bad_signature"}
    assert set(reasons) >= wanted | {"wrong_source"}


def test_what_is_rejected_is_in_the_log_with_the_reason(tmp_path: Path) -> None:
    simulation = started(SecuredSimulation, channel=CHANNEL, logs=tmp_path)
    attacker = simulation.radio.link(666)
    data = seal(STRANGER, cancel(src=2, session=(1, 1), dst=1), 3000)
    simulation.clock.at(3000, lambda: attacker.send(data, 0, "666:1"))
    simulation.run(UNTIL)
    lines = [json.loads(line) for line in (tmp_path / "1.ndjson").read_text().splitlines()]
    (line,) = [line for line in lines if "rejected" in line]
    assert (line["ev"], line["rejected"], line["tx"]) == ("receive", "unknown_authority", "666:1")
    assert line["t_ms"] == 3005 and explain(read(tmp_path / "1.ndjson")).verdict == "allowed"
    assert simulation.services[1].statistics.as_dict()["rejected"] == {"unknown_authority": 1}


def test_with_an_authority_unknown_to_one_side_there_is_no_session() -> None:
    simulation = SecuredSimulation(channel=CHANNEL)
    simulation.credentials[2] = STRANGER
    simulation = started(lambda: simulation)
    simulation.run(13_000)
    one, two = (simulation.services[n] for n in (1, 2))
    assert one.application.calls == [("fallback", (1, 1), "no_participants")]
    assert set(one.statistics.rejected) == {"unknown_authority", "unknown_signer"}
    assert ("fallback", (1, 1), "timeout") in two.application.calls and not two.statistics.rejected


def test_act_2_a_certificate_that_expires_in_mid_session_ends_the_session() -> None:
    simulation = SecuredSimulation(channel=CHANNEL)
    simulation.credentials[2] = credentials(2, not_before=0, not_after=4)
    simulation.add(1, Noted(concerned_by_all=False, maneuver_ms=60_000))
    simulation.add(2, Noted())
    simulation.request(1, 0)
    simulation.run(8000)
    calls = [simulation.services[n].application.calls for n in (1, 2)]
    assert [isinstance(each[-2], AgreedManeuver) for each in calls] == [True, True]
    assert calls[0][-1] == ("fallback", (1, 1), "cam_loss")
    assert set(simulation.services[1].statistics.rejected) == {"certificate_expired"}


def test_a_certificate_is_renewed_while_a_session_runs() -> None:
    simulation = SecuredSimulation(channel=CHANNEL)
    simulation.credentials[2] = credentials(2, not_before=0, not_after=6)
    simulation = started(lambda **more: simulation)
    renewed = credentials(2, private=99, not_before=0, not_after=DAY)
    pseudonym = credentials(22, not_before=0, not_after=DAY)
    service, link = simulation.services[2], simulation.links[2]
    refused: list[str] = []

    def renew() -> None:
        assert service.state.bound
        with pytest.raises(PseudonymError):
            change_credentials(service, link, pseudonym)
        refused.append("pseudonym")
        change_credentials(service, link, renewed)

    simulation.clock.at(5000, renew)
    simulation.run(UNTIL)
    assert refused and service.application.calls[-1] == ("finished", (1, 1))
    assert not simulation.services[1].statistics.rejected
    change_credentials(service, link, pseudonym)


def wired(received: Receiver) -> Wire:
    wire, clock = Wire(), SecuredSimulation(channel=CHANNEL).clock
    SecuredLink(wire, Signer(OWN, "json"), new_verifier(), clock).open(received)
    return wire


def test_a_link_learns_the_sender_of_what_is_accepted_only() -> None:
    """``UdpLink`` then sends to the address from which it came."""
    received: list[bytes] = []
    wire = wired(lambda data, tx: received.append(data))
    waiting, whole = seal(INSIDER, cam(666, 0), 0, whole=False), seal(INSIDER, cam(666, 1), 1)
    lie, echo = seal(INSIDER, cam(2, 0), 0), seal(OWN, cam(1, 0), 0)
    got = [wire.receive(each, None) for each in (b"", waiting, whole, whole, lie, echo)]
    assert got == [None, None, 666, None, None, None]
    assert received == [encode(cam(666, 0)), encode(cam(666, 1))]


def test_an_exception_of_the_application_loses_no_other_message() -> None:
    received: list[bytes] = []

    def receive(data: bytes, tx: str | None) -> None:
        received.append(data)
        raise RuntimeError("the application")

    wire = wired(receive)
    wire.receive(seal(INSIDER, cam(666, 0), 0, whole=False), None)
    with pytest.raises(RuntimeError):
        wire.receive(seal(INSIDER, cam(666, 1), 1), None)
    assert received == [encode(cam(666, 0)), encode(cam(666, 1))]


def test_a_certificate_is_asked_for_and_sent_on_request() -> None:
    """2 starts listening late, just after the whole certificate of 1."""
    simulation = SecuredSimulation(channel=CHANNEL)
    for n, at in ((1, 0), (2, 300)):
        simulation.clock.at(at, lambda n=n: simulation.add(n, Noted()))  # type: ignore[misc]
    simulation.run(1000)
    sent = [envelope.read(data, "json") for _, data in simulation.air]
    of_one = [each for each in sent if each.signer == simulation.credentials[1].certificate.digest]
    asked = [each.wanted for each in sent if each.wanted is not None]
    assert set(asked) == {simulation.credentials[1].certificate.digest}
    assert sum(each.certificate is not None for each in of_one) >= 2
    assert 1 in simulation.services[2].neighbours and not simulation.services[2].statistics.rejected


def test_the_peer_comes_first_then_who_is_near() -> None:
    simulation = started(SecuredSimulation, channel=CHANNEL)
    simulation.add(3, Noted(concerned_by_all=False))
    ranking = simulation.links[1].verifier.ranking
    assert [ranking((n,)) for n in (2, 3, 4)] == [2, 2, 2]
    simulation.clock.run(1900)
    assert [ranking((n,)) for n in (2, 3, 4)] == [1, 1, 2]
    simulation.clock.run(2500)
    assert simulation.services[1].state.phase == "ADVERTISING"
    assert [ranking((n,)) for n in (2, 3, 4)] == [0, 1, 2]
    simulation.clock.run(5000)
    assert simulation.services[1].state.peer == 2 and ranking((9, 2)) == 0
    far = simulation.services[1].neighbours[3]
    for distance, rank in ((100_000, 1), (100_001, 2)):
        x_mm = simulation.services[1].application.kinematics(simulation.clock.now()).x_mm
        at = replace(far, x_mm=x_mm - distance)
        simulation.services[1].neighbours[3] = at
        assert ranking((3,)) == rank


def test_what_is_over_the_budget_is_counted_and_not_logged(tmp_path: Path) -> None:
    simulation = started(SecuredSimulation, channel=CHANNEL, logs=tmp_path)
    attacker = simulation.radio.link(666)

    def flood() -> None:
        header = {cose.KID: simulation.credentials[1].certificate.digest}
        payload = cose.encode([1500, encode(cam(1, 1500))])
        data = cose.sign(key(66), header, payload, envelope.CONTEXT + b"json")
        for _ in range(800):
            attacker.send(data, 0, "666:1")

    simulation.clock.at(1500, flood)
    simulation.run(4000)
    counted = simulation.services[2].statistics.rejected
    logged = Counter(
        json.loads(line).get("rejected") for line in (tmp_path / "2.ndjson").open(encoding="utf-8")
    )
    assert counted["over_budget"] > 0 and "over_budget" not in logged
    assert logged["bad_signature"] == LOGGED_PER_SECOND < counted["bad_signature"]


@pytest.mark.parametrize(("age_ms", "used"), [(1, False), (0, True)])
def test_end_8_a_copy_of_its_own_last_envelope_stops_no_restart(age_ms: int, used: bool) -> None:
    """Another process with the same keys does."""
    own, clock = credentials(1), Jumpy()
    clock.time = NOW

    class Air(Wire):
        def open(self, receive: Receiver) -> None:
            receive(seal(own, cam(1, NOW - age_ms), NOW - age_ms), None)

    link = SecuredLink(Air(), Signer(own, "json"), new_verifier(), clock)
    link.on_air = False

    async def listen() -> None:
        await _free(link, JSON, 1, 1, asyncio.get_running_loop().create_future())

    with pytest.raises(LinkError, match="in use") if used else nullcontext():
        asyncio.run(listen())


def test_without_the_extra_the_import_says_what_to_install() -> None:
    code = "import sys; sys.modules['cbor2'] = None\nimport automcm.links.secured"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    said = "MissingExtra: a secured link needs cbor2: pip install 'automcm[secure]'"
    assert done.stderr.strip().endswith(said)


def test_a_due_timer_precedes_a_rejected_datagram_in_the_log() -> None:
    """Otherwise the log of a station that was away would show a timer that is too late."""
    sink, clock = BytesIO(), Jumpy()
    about = {"run": "x", "station": 1, "implementation": "automcm", "version": "0"}
    service, _, _ = alone(clock=clock, log=LogWriter(sink, **about))
    service.command(LANE_CHANGE)
    clock.time = 5000
    service.rejected("stale", b"\x84", "2:1")
    lines = [json.loads(line) for line in sink.getvalue().splitlines()]
    assert [line["timer"]["name"] for line in lines if line.get("op") == "expire"]
    assert lines[-1]["rejected"] == "stale" and lines[-1]["t_ms"] == 5000


def test_end_5_what_is_no_message_is_logged_up_to_a_frame() -> None:
    sink, data = BytesIO(), bytes(range(256)) * 250
    about = {"run": "x", "station": 1, "implementation": "automcm", "version": "0"}
    service, _, _ = alone(log=LogWriter(sink, **about))
    service.receive(data)
    service.rejected("bad_signature", data)
    lines = [json.loads(line) for line in sink.getvalue().splitlines()]
    raw = [base64.b64decode(line["raw"]) for line in lines if "raw" in line]
    assert raw == [data[:FRAME_BYTES]] * 2
