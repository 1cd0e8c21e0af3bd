"""CBOR, P-256 and COSE with the standard library alone, to make the vectors of secured_vectors.

Intentionally independent of the reference and of its libraries, and as slow as that is.
"""

from __future__ import annotations

import hashlib
import hmac
from functools import cache
from typing import Any

Json = Any
Point = tuple[int, int] | None

P = 2**256 - 2**224 + 2**192 + 2**96 - 1
ORDER = 0xFFFFFFFF00000000FFFFFFFFFFFFFFFFBCE6FAADA7179E84F3B9CAC2FC632551
BASE = (
    0x6B17D1F2E12C4247F8BCE6E563A440F277037D812DEB33A0F4A13945D898C296,
    0x4FE342E2FE1A7F9B8EE7EB4A7C0F9E162BCE33576B315ECECBB6406837BF51F5,
)


class Raw(bytes):
    """CBOR that is already encoded, for what no encoder of this profile writes."""


def cbor(value: Any) -> bytes:
    """The deterministic encoding (RFC 8949, 4.2)."""
    match value:
        case Raw():
            return bytes(value)
        case bool():
            return b"\xf5" if value else b"\xf4"
        case int():
            return _head(0, value) if value >= 0 else _head(1, -1 - value)
        case bytes():
            return _head(2, len(value)) + value
        case str():
            return _head(3, len(value.encode())) + value.encode()
        case list():
            return _head(4, len(value)) + b"".join(map(cbor, value))
        case dict():
            pairs = sorted((cbor(key), cbor(each)) for key, each in value.items())
            return _head(5, len(value)) + b"".join(key + each for key, each in pairs)
    raise TypeError(value)


def _head(major: int, number: int) -> bytes:
    if number < 24:
        return bytes([major << 5 | number])
    size = next(n for n in range(4) if number < 256 ** (1 << n))
    return bytes([major << 5 | 24 + size]) + number.to_bytes(1 << size)


def _sum(a: Point, b: Point) -> Point:
    if a is None or b is None:
        return a or b
    (x1, y1), (x2, y2) = a, b
    if x1 == x2 and (y1 + y2) % P == 0:
        return None
    above, below = (3 * x1 * x1 - 3, 2 * y1) if a == b else (y2 - y1, x2 - x1)
    slope = above * pow(below, -1, P)
    x = (slope * slope - x1 - x2) % P
    return x, (slope * (x1 - x) - y1) % P


@cache
def public(private: int) -> tuple[int, int]:
    """The point of this private key."""
    found: Point = None
    twice: Point = BASE
    while private:
        if private & 1:
            found = _sum(found, twice)
        twice, private = _sum(twice, twice), private >> 1
    assert found is not None
    return found


@cache
def signature(private: int, data: bytes) -> tuple[int, int]:
    """r and s of ECDSA with SHA-256, deterministic (RFC 6979, 3.2); s may be high."""
    hashed = hashlib.sha256(data).digest()
    seed = private.to_bytes(32) + (int.from_bytes(hashed) % ORDER).to_bytes(32)
    key, value = bytes(32), b"\1" * 32
    for step in (b"\0", b"\1"):
        key = hmac.digest(key, value + step + seed, "sha256")
        value = hmac.digest(key, value, "sha256")
    value = hmac.digest(key, value, "sha256")
    k = int.from_bytes(value)
    assert 0 < k < ORDER  # else RFC 6979 takes the next one, which no vector needs
    r = public(k)[0] % ORDER
    return r, pow(k, -1, ORDER) * (int.from_bytes(hashed) + r * private) % ORDER


def joined(r: int, s: int) -> bytes:
    """A signature as in COSE."""
    return r.to_bytes(32) + s.to_bytes(32)


def sign1(
    private: int, header: dict[int, Any] | Raw, payload: bytes, context: bytes, high: bool = False
) -> list[Any]:
    """A COSE_Sign1 (RFC 9052); the algorithm is ES256 unless ``header`` has another or None."""
    if not isinstance(header, Raw):
        header = {key: each for key, each in ({1: -7} | header).items() if each is not None}
    protected = cbor(header)
    r, s = signature(private, cbor(["Signature1", protected, context, payload]))
    s = max(s, ORDER - s) if high else min(s, ORDER - s)
    return [protected, {}, payload, joined(r, s)]


def compressed(private: int) -> bytes:
    """The point of a key, compressed (SEC 1, 2.3.3)."""
    x, y = public(private)
    return bytes([2 + y % 2]) + x.to_bytes(32)


def cose_key(private: int) -> dict[int, Any]:
    """The public key of a private one (RFC 9052, 7)."""
    x, y = public(private)
    return {1: 2, -1: 1, -2: x.to_bytes(32), -3: y % 2 == 1}


def digest(data: bytes) -> bytes:
    """The last 8 bytes of SHA-256."""
    return hashlib.sha256(data).digest()[-8:]
