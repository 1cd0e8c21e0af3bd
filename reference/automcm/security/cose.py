"""COSE_Sign1 (RFC 9052) with ES256, in deterministic CBOR (RFC 8949, 4.2).

A signed object is ``[protected, {}, payload, signature]``.  Nothing in it is unsigned: the
unprotected map is empty, each content has one encoding, and a signature has one form (s is at most
half the order of the curve).  ``context`` is the external data (external_aad) that keeps the kinds
of signed objects apart.

Needs the extra ``automcm[secure]``; importing this without it raises MissingExtra.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from automcm_spec.support.extras import MissingExtra, missing

try:
    import cbor2
    from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.hazmat.primitives.asymmetric.utils import (
        decode_dss_signature,
        encode_dss_signature,
    )
except ModuleNotFoundError:
    raise MissingExtra(f"a secured link {missing('secure')}") from None

PrivateKey = ec.EllipticCurvePrivateKey
PublicKey = ec.EllipticCurvePublicKey

ALGORITHM, KID, KCWT = 1, 4, 13
"""Header parameters: the algorithm, the digest of the signer's key or certificate, and a whole
certificate (RFC 9528)."""
ES256 = -7
ORDER = 0xFFFFFFFF00000000FFFFFFFFFFFFFFFFBCE6FAADA7179E84F3B9CAC2FC632551
"""The order of P-256."""
MAX_DEPTH = 6
MAP_BYTES = 640
"""The longest encoding with a map that has keys: a certificate in a header.  In a datagram, keys
with equal hashes could take 0.15 s."""

_SIZES = {24: 1, 25: 2, 26: 4, 27: 8}
"""How many bytes of a number follow the first byte of an item, by its low five bits."""
_SIGN = ec.ECDSA(hashes.SHA256(), deterministic_signing=True)  # RFC 6979: no random numbers
_VERIFY = ec.ECDSA(hashes.SHA256())


class Malformed(ValueError):
    """Bytes that are not the deterministic encoding of what was expected."""


def new_key() -> PrivateKey:
    """A private key of P-256, from the system's random numbers."""
    return ec.generate_private_key(ec.SECP256R1())


def public_key(point: bytes) -> PublicKey:
    """The key with this encoded point.  Raises Malformed for a point that is not of P-256."""
    try:
        return PublicKey.from_encoded_point(ec.SECP256R1(), point)
    except ValueError:
        raise Malformed("not a point of P-256") from None


@dataclass(frozen=True, slots=True)
class Signed:
    """A signed object whose signature is not verified yet."""

    header: dict[int, Any]
    """The protected header without the algorithm."""
    payload: bytes
    signature: bytes
    content: bytes
    """The signed bytes (Sig_structure)."""


def private_pem(key: PrivateKey) -> bytes:
    """A private key in PEM (PKCS #8), not encrypted."""
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def public_pem(key: PublicKey) -> bytes:
    """A public key in PEM."""
    return key.public_bytes(
        serialization.Encoding.PEM, serialization.PublicFormat.SubjectPublicKeyInfo
    )


def read_pem(data: bytes) -> PrivateKey | PublicKey | None:
    """The key of P-256 in a PEM file; None for anything else."""
    for load in (
        lambda: serialization.load_pem_private_key(data, None),
        lambda: serialization.load_pem_public_key(data),
    ):
        with suppress(ValueError, TypeError, UnsupportedAlgorithm):
            key = load()
            if isinstance(key, PrivateKey | PublicKey) and key.curve.name == "secp256r1":
                return key
    return None


def encode(value: Any) -> bytes:
    """The deterministic encoding.  The keys of our maps have the same order by length as by bytes,
    in which the two sets of rules differ."""
    return cbor2.dumps(value, canonical=True)


def decode(data: bytes, *, with_map: bool = False) -> Any:
    """The value of integers, bytes, texts, booleans, lists, and maps, which are empty or
    ``with_map`` have integer keys.

    Raises Malformed for anything else, and for another encoding than that of ``encode``.
    """
    if with_map and len(data) > MAP_BYTES:
        raise Malformed(f"a map of {len(data)} bytes, more than {MAP_BYTES}")
    try:
        value = cbor2.loads(
            data,
            max_depth=MAX_DEPTH,
            allow_indefinite=False,
            allow_duplicate_keys=False,
            strict_hashable_types=not with_map,
        )
    except (cbor2.CBORDecodeError, ValueError, OverflowError) as error:
        raise Malformed(str(error)) from None
    if not _plain(value, MAX_DEPTH) or encode(value) != data:
        raise Malformed("not a deterministic encoding")
    return value


def short_list(data: bytes) -> list[Any]:
    """The items of a list of at most four: integers, bytes, and empty maps.

    As ``decode``, but its work does not depend on the content: whoever sends a datagram could fill
    it with values.  Raises Malformed.
    """
    count, at = data[0] - 0x80 if data else 0, 1
    items: list[Any] = []
    for _ in range(count if 0 < count <= 4 else 0):
        kind, low = divmod(data[at], 32) if at < len(data) else (7, 0)
        size = _SIZES.get(low, 0)
        number = int.from_bytes(data[at + 1 : at + 1 + size]) if size else low
        at += 1 + size
        match kind:
            case 0:
                items.append(number)
            case 1:
                items.append(~number)
            case 2:
                items.append(data[at : at + number])
                at += number
            case 5:
                items.append({})
            case _:
                break
    if encode(items) != data:
        raise Malformed("not a short list in the deterministic encoding")
    return items


def _plain(value: Any, depth: int) -> bool:
    if type(value) is list:
        return depth > 0 and all(_plain(each, depth - 1) for each in value)
    if type(value) is dict:
        return depth > 0 and all(
            type(key) is int and _plain(each, depth - 1) for key, each in value.items()
        )
    return type(value) in (int, bytes, str, bool)


def sign(key: PrivateKey, header: dict[int, Any], payload: bytes, context: bytes) -> bytes:
    """A signed object."""
    protected = encode({ALGORITHM: ES256} | header)
    r, s = decode_dss_signature(key.sign(_content(protected, payload, context), _SIGN))
    signature = r.to_bytes(32) + min(s, ORDER - s).to_bytes(32)
    return encode([protected, {}, payload, signature])


def read(data: bytes, context: bytes) -> Signed:
    """A signed object, before its verification.  Raises Malformed."""
    return unpacked(short_list(data), context)


def unpacked(value: Any, context: bytes) -> Signed:
    """As ``read``, from the decoded object."""
    match value:
        case [
            bytes() as protected,
            dict() as unprotected,
            bytes() as payload,
            bytes() as signature,
        ]:
            header = decode(protected, with_map=True)
            if unprotected or type(header) is not dict or header.pop(ALGORITHM, None) != ES256:
                raise Malformed("the header must be protected and name ES256")
            if len(signature) != 64:
                raise Malformed("a signature has 64 bytes")
            return Signed(header, payload, signature, _content(protected, payload, context))
    raise Malformed("not a COSE_Sign1")


def verify(signed: Signed, key: PublicKey) -> bool:
    """Whether ``key`` has signed it."""
    r, s = int.from_bytes(signed.signature[:32]), int.from_bytes(signed.signature[32:])
    if s > ORDER // 2:
        return False
    try:
        key.verify(encode_dss_signature(r, s), signed.content, _VERIFY)
    except InvalidSignature:
        return False
    return True


def _content(protected: bytes, payload: bytes, context: bytes) -> bytes:
    return encode(["Signature1", protected, context, payload])
