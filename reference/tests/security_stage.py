"""Keys from numbers, stations with certificates, and a simulation on secured links."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from automcm_stage import cam
from cryptography.hazmat.primitives.asymmetric import ec

from automcm.encoding.codec import JSON
from automcm.links.link import Link, Receiver
from automcm.links.secured import SecuredLink
from automcm.security import certificates, cose, envelope, verifier
from automcm.security.certificates import Credentials
from automcm.security.signer import Signer
from automcm.service.secured_service import attach
from automcm.service.service import McService
from automcm_simulation.road.simulation import Simulation
from automcm_spec.vocabulary.messages import Cam, Message, encode
from automcm_spec.vocabulary.parameters import Parameters

NOW = 1_780_000_000_000
"""A time in ms."""
DAY = 86_400


def key(number: int) -> cose.PrivateKey:
    return ec.derive_private_key(number, ec.SECP256R1())


AUTHORITY, OTHER_AUTHORITY = key(1), key(2)


def credentials(
    *ids: int, authority: cose.PrivateKey = AUTHORITY, private: int = 0, **claims: Any
) -> Credentials:
    """Of a station with these ids, valid for a day around NOW."""
    own = key(private or 1000 + ids[0])
    claims = {"not_before": NOW // 1000 - DAY, "not_after": NOW // 1000 + DAY} | claims
    return Credentials(certificates.issue(authority, own.public_key(), ids=ids, **claims), own)


def seal(
    of: Credentials, message: Message | Cam, now: int = NOW, *, whole: bool = True, **more: Any
) -> bytes:
    return envelope.seal(of, "json", encode(message), now, whole=whole, **more)


def new_verifier(**more: Any) -> verifier.Verifier:
    return verifier.Verifier([AUTHORITY.public_key()], JSON, Parameters(), **more)


def verdicts(by: verifier.Verifier, data: bytes, now: int = NOW) -> list[str]:
    """Of each datagram judged now: why it was rejected, or ``accepted``."""
    return [
        each.reason if isinstance(each, verifier.Rejected) else "accepted"
        for each in by.receive(data, now)
    ]


def knowing(*others: Credentials, **more: Any) -> verifier.Verifier:
    """A verifier that has the certificates of these stations."""
    by = new_verifier(**more)
    for each in others:
        (src, *_) = each.certificate.ids
        assert verdicts(by, seal(each, cam(src, NOW - 500), NOW - 500), NOW - 500) == ["accepted"]
    return by


class Tap:
    """A link that also notes what is sent over another."""

    def __init__(self, link: Link, note: Callable[[bytes], None]) -> None:
        self._link, self._note = link, note
        self.open: Callable[[Receiver], None] = link.open
        self.close = link.close

    def send(self, data: bytes, to: int, tx: str) -> None:
        self._note(data)
        self._link.send(data, to, tx)


class SecuredSimulation(Simulation):
    """Stations whose messages are signed; ``air`` has every envelope with its time."""

    def __init__(self, **more: Any) -> None:
        super().__init__(**more)
        self.air: list[tuple[int, bytes]] = []
        self.links: dict[int, SecuredLink] = {}
        self.credentials: dict[int, Credentials] = {}

    def link(self, station_id: int) -> Link:
        own = self.credentials.setdefault(
            station_id, credentials(station_id, not_before=0, not_after=DAY)
        )
        tapped = Tap(
            super().link(station_id), lambda data: self.air.append((self.clock.now(), data))
        )
        signer = Signer(own, "json")
        self.links[station_id] = SecuredLink(tapped, signer, new_verifier(), self.clock)
        return self.links[station_id]

    def add(self, station_id: int, *rest: Any, **more: Any) -> McService:
        service = super().add(station_id, *rest, **more)
        attach(service, self.links[station_id])
        return service
