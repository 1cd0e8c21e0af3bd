"""Certificates of stations, and lists of revoked ones: both signed by an authority.

A certificate is a CWT (RFC 8392) with the station's key in ``cnf`` (RFC 8747).  Times are whole
seconds since 1970, as in every CWT.
"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable, Set
from dataclasses import dataclass, field
from typing import Any, Literal, Required, TypedDict, Unpack, get_args

from automcm.security import cose
from automcm.security.cose import Malformed, PrivateKey, PublicKey
from automcm_spec.vocabulary.messages import Cam, Message

Role = Literal["prescriber", "receiver", "cam"]
"""What a certificate permits: to lead a session, to answer in one, to send CAMs."""
ROLES: tuple[Role, ...] = get_args(Role)

CERTIFICATE_BYTES = 512
MAX_IDS = 16
DIGEST_BYTES = 8

_EXPIRES, _BEGINS, _CNF = 4, 5, 8
_IDS, _ROLES, _STATION_TYPE, _SCENARIOS = -65537, -65538, -65539, -65540  # for private use
_COSE_KEY, _KTY, _CRV, _X, _Y = 1, 1, -1, -2, -3
_EC2, _P256 = 2, 1
_CONTEXT = b"automcm.certificate/1"
_REVOKED = b"automcm.revocations/1"
_CLAIMS = frozenset({_EXPIRES, _BEGINS, _CNF, _IDS, _ROLES, _STATION_TYPE})


def digest(data: bytes) -> bytes:
    """The last 8 bytes of SHA-256, as the HashedId8 of IEEE 1609.2."""
    return hashlib.sha256(data).digest()[-DIGEST_BYTES:]


@dataclass(frozen=True, slots=True)
class Certificate:
    """A station's certificate.  Its signature counts only after ``Verifier`` has checked it."""

    ids: tuple[int, ...]
    """The station ids that its holder may use."""
    not_before: int
    not_after: int
    """It is valid from ``not_before`` until just before ``not_after``."""
    roles: frozenset[Role]
    scenarios: frozenset[str] | None
    """The scenarios that its holder may advertise; None: all."""
    station_type: int
    """As in ETSI TS 102 894-2: 5 a car, 10 a special vehicle, 15 a road-side unit."""
    authority: bytes
    """The digest of the authority's key."""
    digest: bytes
    encoded: Any = field(repr=False)
    """The decoded CBOR, for the header of an envelope."""
    signed: cose.Signed = field(repr=False)
    point: bytes = field(repr=False)

    def key(self) -> PublicKey:
        """The station's key.  Raises Malformed for a point that is not on the curve."""
        return cose.public_key(self.point)

    def permits(self, message: Message | Cam) -> bool:
        """Whether its holder may send this message.

        Only an Advertisement names a scenario.  What follows in its session needs no check of it,
        because nobody joins a session without its Advertisement (ADV-3).
        """
        if message.type == "Advertisement" and self.scenarios is not None:
            return "prescriber" in self.roles and message.scenario in self.scenarios
        return needed(message) in self.roles


def needed(message: Message | Cam) -> Role:
    """The role that may send this message; of a Cancel or Ack by its session."""
    match message.type:
        case "CAM":
            return "cam"
        case "Advertisement" | "Prescription" | "Fin":
            return "prescriber"
        case "Intention" | "Acceptance":
            return "receiver"
    return "prescriber" if message.session[0] == message.src else "receiver"


def authority_digest(key: PublicKey) -> bytes:
    """The digest that names an authority in what it has signed."""
    return digest(cose.encode(_cose_key(key)))


def _cose_key(key: PublicKey) -> dict[int, Any]:
    numbers = key.public_numbers()
    return {_KTY: _EC2, _CRV: _P256, _X: numbers.x.to_bytes(32), _Y: numbers.y % 2 == 1}


class Claims(TypedDict, total=False):
    """The claims of a new certificate, as in ``Certificate``; by default all roles, of a car."""

    ids: Required[Iterable[int]]
    not_before: Required[int]
    not_after: Required[int]
    roles: Iterable[Role]
    scenarios: Iterable[str] | None
    station_type: int


def issue(authority: PrivateKey, key: PublicKey, **given: Unpack[Claims]) -> Certificate:
    """A certificate for the holder of ``key``.  Raises ValueError for what ``read`` refuses."""
    claims = {
        _EXPIRES: given["not_after"],
        _BEGINS: given["not_before"],
        _CNF: {_COSE_KEY: _cose_key(key)},
        _IDS: sorted(given["ids"]),
        _ROLES: sum(1 << ROLES.index(role) for role in {*given.get("roles", ROLES)}),
        _STATION_TYPE: given.get("station_type", 5),
    }
    if (scenarios := given.get("scenarios")) is not None:
        claims[_SCENARIOS] = sorted(scenarios)
    header = {cose.KID: authority_digest(authority.public_key())}
    return read(cose.sign(authority, header, cose.encode(claims), _CONTEXT))


def read(data: bytes) -> Certificate:
    """A certificate, before its verification.  Raises Malformed."""
    return unpacked(cose.decode(data, with_map=True))


def encoded(certificate: Certificate) -> bytes:
    """The bytes of a certificate."""
    return cose.encode(certificate.encoded)


def unpacked(value: Any) -> Certificate:
    """As ``read``, from the decoded object."""
    data = cose.encode(value)
    if len(data) > CERTIFICATE_BYTES:
        raise Malformed(f"certificate: {len(data)} bytes, more than {CERTIFICATE_BYTES}")
    signed = cose.unpacked(value, _CONTEXT)
    claims = _map(cose.decode(signed.payload, with_map=True), _CLAIMS, optional={_SCENARIOS})
    key = _map(_map(claims[_CNF], {_COSE_KEY})[_COSE_KEY], {_KTY, _CRV, _X, _Y})
    authority = _map(signed.header, {cose.KID})[cose.KID]
    x, odd, ids = key[_X], key[_Y], claims[_IDS]
    not_before, not_after = claims[_BEGINS], claims[_EXPIRES]
    roles, station_type = claims[_ROLES], claims[_STATION_TYPE]
    scenarios = claims.get(_SCENARIOS)
    if not (
        (_number(key[_KTY]), _number(key[_CRV])) == (_EC2, _P256)
        and (type(x), type(odd), type(authority)) == (bytes, bool, bytes)
        and (len(x), len(authority)) == (32, DIGEST_BYTES)
        and 0 <= _number(not_before) < _number(not_after) < 2**40
        and _ascending(ids, int)
        and 0 < len(ids) <= MAX_IDS
        and 0 < ids[0] <= ids[-1] < 2**32
        and 0 < _number(roles) < 1 << len(ROLES)
        and 0 <= _number(station_type) < 256
        and (scenarios is None or _ascending(scenarios, str))
    ):
        raise Malformed("certificate: a claim is missing or out of bounds")
    return Certificate(
        ids=tuple(ids),
        not_before=not_before,
        not_after=not_after,
        roles=frozenset(role for n, role in enumerate(ROLES) if roles >> n & 1),
        scenarios=None if scenarios is None else frozenset(scenarios),
        station_type=station_type,
        authority=authority,
        digest=digest(data),
        encoded=value,
        signed=signed,
        point=(b"\3" if odd else b"\2") + x,
    )


def _map(value: Any, keys: Set[int], *, optional: Set[int] = frozenset()) -> dict[int, Any]:
    """A map with exactly these keys.  Raises Malformed."""
    if type(value) is not dict or value.keys() - optional != keys:
        raise Malformed("a map has other keys than expected")
    return value


def _number(value: Any) -> int:
    """An integer, or -1 for anything else."""
    return value if type(value) is int else -1


def _ascending(value: Any, kind: type) -> bool:
    """Whether it is a list of this type in ascending order, without duplicates."""
    return (
        type(value) is list
        and all(type(each) is kind for each in value)
        and value == sorted({*value})
    )


@dataclass(frozen=True, slots=True)
class Credentials:
    """A certificate with the private key of its holder."""

    certificate: Certificate
    key: PrivateKey = field(repr=False)

    def __post_init__(self) -> None:
        own = authority_digest(self.key.public_key())
        if own != authority_digest(self.certificate.key()):
            raise ValueError("the private key is not that of the certificate")


@dataclass(frozen=True, slots=True)
class Revocations:
    """The certificates that an authority has revoked."""

    authority: bytes
    issued: int
    """In seconds since 1970; a list replaces those of the same authority issued before it."""
    digests: frozenset[bytes]
    signed: cose.Signed = field(repr=False)


def revoke(authority: PrivateKey, digests: Collection[bytes], issued: int) -> bytes:
    """A list of revoked certificates by their digests."""
    header = {cose.KID: authority_digest(authority.public_key())}
    return cose.sign(authority, header, cose.encode([issued, sorted({*digests})]), _REVOKED)


def read_revocations(data: bytes) -> Revocations:
    """A list of revoked certificates, before its verification.  Raises Malformed."""
    signed = cose.read(data, _REVOKED)
    authority = _map(signed.header, {cose.KID})[cose.KID]
    match cose.decode(signed.payload):
        case [int() as issued, digests] if (
            type(authority) is bytes
            and 0 <= _number(issued) < 2**40
            and _ascending(digests, bytes)
            and all(len(each) == DIGEST_BYTES for each in digests)
        ):
            return Revocations(authority, issued, frozenset(digests), signed)
    raise Malformed("not a list of revoked certificates")
