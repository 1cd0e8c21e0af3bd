"""The runs of the reference whose logs are in the corpus; seeded, so that every byte is fixed."""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import partial
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric import ec

from automcm.encoding.codec import JSON
from automcm.links.link import Link
from automcm.links.secured import SecuredLink
from automcm.links.simulated_radio import Channel
from automcm.security import certificates, envelope
from automcm.security.certificates import Credentials
from automcm.security.cose import PrivateKey
from automcm.security.signer import Signer
from automcm.security.verifier import Verifier
from automcm.service.secured_service import attach
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_spec.vocabulary.messages import Cam, encode
from automcm_spec.vocabulary.parameters import Parameters

PRESCRIBER, RECEIVER, ATTACKER = 1001, 2002, 6666
EVERY = 17
"""One of so many envelopes is changed."""
Sent = tuple[int, bytes, str]
"""A transmission: its time, its bytes and its id."""


def four_vehicles(folder: Path) -> None:
    """The paper's four vehicles, with loss."""
    simulation = Simulation(seed=3, channel=Channel(loss=0.2, duplicate=0.05), logs=folder)
    for station in (1001, 2002, 3003, 4004):
        simulation.add(station, Straight(target=3003), Parameters(t_cam=400))
    simulation.request(1001, at=500)
    simulation.run(until=10_000)


def pair(folder: Path) -> None:
    """A prescriber and a receiver that refuses once; the bad logs are edits of these."""
    simulation = Simulation(seed=5, channel=Channel(loss=0.25, duplicate=0.1), logs=folder)
    for station in (PRESCRIBER, RECEIVER):
        driver = Straight(refuse_first=1, maneuver_ms=900)
        simulation.add(station, driver, Parameters(t_timeout=500, t_cam=500, max_rounds=2))
    simulation.request(PRESCRIBER, at=300)
    simulation.run(until=4000)


def _key(number: int) -> PrivateKey:
    return ec.derive_private_key(number, ec.SECP256R1())


AUTHORITY = _key(1)


def _credentials(station: int, authority: PrivateKey = AUTHORITY) -> Credentials:
    key = _key(1000 + station)
    certificate = certificates.issue(
        authority, key.public_key(), ids=[station], not_before=0, not_after=3600
    )
    return Credentials(certificate, key)


class _Disturbed:
    """A link on which some envelopes are changed; all are noted in ``air``."""

    def __init__(self, link: Link, air: list[Sent], now: Callable[[], int]) -> None:
        self._link, self._air, self._now = link, air, now
        self.open, self.close = link.open, link.close

    def send(self, data: bytes, to: int, tx: str) -> None:
        self._air.append((self._now(), data, tx))
        if len(self._air) % EVERY == 0:
            data = data[:-1] + bytes([data[-1] ^ 1])  # this byte belongs to the signature
        self._link.send(data, to, tx)


class _Secured(Simulation):
    """Stations whose messages are signed."""

    def __init__(self, logs: Path) -> None:
        super().__init__(seed=7, channel=Channel(delay_ms=(2, 20)), logs=logs)
        self.air: list[Sent] = []

    def link(self, station_id: int) -> SecuredLink:
        """Changes one of so many envelopes."""
        disturbed = _Disturbed(super().link(station_id), self.air, self.clock.now)
        verifier = Verifier([AUTHORITY.public_key()], JSON, Parameters())
        signer = Signer(_credentials(station_id), JSON.name)
        self.last = SecuredLink(disturbed, signer, verifier, self.clock)
        return self.last


def secured(folder: Path) -> None:
    """A prescriber and a receiver on secured links, in a session in which nothing that an attacker
    sends takes effect."""
    simulation = _Secured(folder)
    for station in (PRESCRIBER, RECEIVER):
        driver = Straight(maneuver_ms=900)
        service = simulation.add(station, driver, Parameters(t_cam=500))
        attach(service, simulation.last)
    attacker, rng = simulation.radio.link(ATTACKER), random.Random(7)
    now = simulation.clock.now

    def forge(authority: PrivateKey) -> None:
        """Send a CAM of the prescriber, signed with another certificate."""
        cam = Cam(
            src=PRESCRIBER,
            generation_ms=now(),
            x_mm=0,
            y_mm=0,
            heading_mrad=0,
            speed_mm_s=0,
            marks=(),
        )
        own = _credentials(ATTACKER, authority)
        data = envelope.seal(own, JSON.name, encode(cam), now(), whole=True)
        attacker.send(data, 0, f"{ATTACKER}:{now()}")

    def repeat(oldest: int, newest: int) -> None:
        """Send an envelope of this age in ms again."""
        aged = [one for one in simulation.air if oldest <= now() - one[0] <= newest]
        _, data, tx = rng.choice(aged)
        attacker.send(data, 0, tx)

    for attack, first in (
        (partial(forge, AUTHORITY), 1500),
        (partial(forge, _key(2)), 1500),
        (partial(repeat, 100, 1500), 1500),
        (partial(repeat, 2200, 4000), 3000),
    ):
        for _ in range(3):
            simulation.clock.at(rng.randrange(first, 4300), attack)
    simulation.request(PRESCRIBER, at=300)
    simulation.run(until=4500)


RUNS = {"four-vehicles": four_vehicles, "pair": pair, "secured": secured}
"""By their folder."""
