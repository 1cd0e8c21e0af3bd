"""Makes certificates, messages, envelopes and what arrives, for secured_vectors.

Imports nothing of the reference and no library.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from cose_maker import cbor, cose_key, digest, sign1

Json = Any
Event = tuple[Json, str, str | None, str | None]
"""What arrives, the verdict on it, the message if it is accepted, and the wanted certificate."""

NOW = 1_780_000_000_000
"""A time in ms since 1970; the events are at so many ms after it."""
DAY, NOW_S = 86_400, NOW // 1000
WINDOW = 2100
AUTHORITY, OTHER_AUTHORITY = 1, 2
PRESCRIBER, RECEIVER, CAM = 1, 2, 4
EXPIRES, BEGINS, CNF, IDS, ROLES, TYPE, SCENARIOS = 4, 5, 8, -65537, -65538, -65539, -65540
CONTEXT = b"automcm.certificate/1"


# Certificates.


def claims(private: int, ids: list[int], **of: Any) -> dict[int, Any]:
    """The claims of a certificate, valid for a day before and after NOW."""
    found = {
        EXPIRES: of.get("end", NOW_S + DAY),
        BEGINS: of.get("begin", NOW_S - DAY),
        CNF: {1: cose_key(private)},
        IDS: ids,
        ROLES: of.get("roles", PRESCRIBER | RECEIVER | CAM),
        TYPE: of.get("station_type", 5),
    }
    return found | ({SCENARIOS: of["scenarios"]} if "scenarios" in of else {})


def certify(
    content: Any, authority: int = AUTHORITY, signer: int = 0, context: bytes = CONTEXT
) -> list[Any]:
    """A certificate; ``signer`` signs it in the name of the authority."""
    return sign1(signer or authority, {4: named(authority)}, cbor(content), context)


def named(authority: int) -> bytes:
    return digest(cbor(cose_key(authority)))


class Station:
    """A station: its private key and its certificate."""

    def __init__(self, private: int, *ids: int, certificate: Any = None, **of: Any) -> None:
        self.private = private
        signed = {name: of.pop(name) for name in ("authority", "signer", "context") if name in of}
        self.certificate = certificate or certify(claims(private, [*ids], **of), **signed)
        self.digest = digest(cbor(self.certificate))


NINE, EIGHT = Station(1009, 9), Station(1008, 8)
OFF_CURVE = {CNF: {1: cose_key(NINE.private) | {-2: (1).to_bytes(32)}}}
"""The claim of a key whose x no point of P-256 has."""


# Messages.


def message(type_: str, src: int = 9, session: tuple[int, int] = (9, 1), **of: Any) -> bytes:
    """A message of a session that station 9 leads."""
    return _json({"v": 1, "type": type_, "src": src, "session": session, "seq": 3} | of)


def cam(src: int = 9, at: int = 0) -> bytes:
    """A CAM that is generated so many ms after NOW."""
    where = {"x_mm": 0, "y_mm": 3500, "heading_mrad": 0, "speed_mm_s": 8333, "marks": [[9, 1]]}
    return _json({"v": 1, "type": "CAM", "src": src, "generation_ms": NOW + at} | where)


def advertisement(scenario: str) -> bytes:
    """An Advertisement of station 9."""
    return message("Advertisement", seq=1, scenario=scenario, details={})


def _json(fields: Json) -> bytes:
    return json.dumps(fields, separators=(",", ":")).encode()


TRAJECTORY = {"t0": 0, "points": [[0, 0, 0], [1000, 8333, 0]]}
FIN = message("Fin", dst=1)
PRESCRIPTION = message(
    "Prescription", dst=1, proposal=1, prescribed=TRAJECTORY, hold_ms=2000, lease_ms=20000
)
INTENTION = message("Intention", session=(1, 1), dst=1, planned=TRAJECTORY)
ACK_AS_PRESCRIBER = message("Ack", dst=1, seq=0, of={"type": "Intention", "seq": 1})
ACK_AS_RECEIVER = message("Ack", session=(1, 1), dst=1, seq=0, of={"type": "Fin", "seq": 3})


# Envelopes and events.


def seal(of: Station, content: bytes, at: int = 0, whole: bool = True, **how: Any) -> list[Any]:
    """An envelope: ``wanted``, ``header``, ``payload``, ``codec`` and ``high`` change it."""
    more = [how["wanted"]] if "wanted" in how else []
    payload = how.get("payload", cbor([NOW + at, content, *more]))
    header = how.get("header", {13: of.certificate} if whole else {4: of.digest})
    context = b"automcm.envelope/1 " + how.get("codec", b"json")
    return sign1(of.private, header, payload, context, how.get("high", False))


def received(
    data: bytes | list[Any], verdict: bytes | str, at: int = 0, wanted: bytes | None = None
) -> Event:
    """The arrival of a datagram so many ms after NOW; ``verdict`` is a reason or the message."""
    encoded = data if isinstance(data, bytes) else cbor(data)
    event = {"now": NOW + at, "envelope": encoded.hex()}
    if isinstance(verdict, str):
        return event, verdict, None, None
    return event, "accepted", verdict.decode(), wanted and wanted.hex()


def accepted(of: Station, content: bytes, at: int = 0, **how: Any) -> Event:
    """An envelope that arrives at once and is accepted."""
    return received(seal(of, content, at, **how), content, at)


def rejected(of: Station, content: bytes, why: str, at: int = 0, **how: Any) -> Event:
    """An envelope that arrives at once and is discarded."""
    return received(seal(of, content, at, **how), why, at)


def revocations(
    revoked: Iterable[Station], at: int, taken: bool, authority: int = AUTHORITY, signer: int = 0
) -> Event:
    """A list of revoked certificates, issued so many seconds after NOW."""
    content = cbor([NOW_S + at, sorted(each.digest for each in revoked)])
    header = {4: named(authority)}
    data = cbor(sign1(signer or authority, header, content, b"automcm.revocations/1"))
    return {"revocations": data.hex()}, "list_taken" if taken else "list_ignored", None, None


def swapped(data: list[Any], **parts: Any) -> list[Any]:
    """A signed object with other parts after it was signed."""
    names = ("protected", "unprotected", "payload", "signature")
    return [parts.get(name, part) for name, part in zip(names, data, strict=True)]


def vector(kernel: str, id_: str, purpose: str, bug: str, inputs: Json, expected: Json) -> Json:
    """A vector."""
    given = {"inputs": inputs, "expected": expected}
    return {"id": f"{kernel}-{id_}", "purpose": purpose, "bug": bug} | given
