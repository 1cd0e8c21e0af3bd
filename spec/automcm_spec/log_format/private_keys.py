"""Finds private keys in a record of a log: as PEM, as JWK, and in base64 as DER or COSE_Key."""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Iterator
from typing import Any, Final

from automcm_spec.log_format.problems import join

_KEY: Final = re.compile(
    rb"-----BEGIN [A-Z ]*PRIVATE KEY-----"
    rb"|\x02\x01\x01\x04\x20"
    rb"|\x20\x01(\x21\x58\x20.{32})?(\x22(\x58\x20.{32}|[\xf4\xf5]))?\x23\x58\x20",
    re.S,
)
"""PEM; an ECPrivateKey (RFC 5915), by its version and 32 bytes; in a COSE_Key (RFC 9053, 7.1),
after the curve and the public key, label -4: d."""
_SUSPECT: Final = re.compile(rb'PRIVATE KEY|"d"|"[A-Za-z0-9+/_-]{43,}=*"')


def private_keys(value: Any, line: bytes) -> Iterator[str]:
    """The paths of the fields of ``value`` that hold a private key; ``line`` is its JSON."""
    if _SUSPECT.search(line):
        yield from _in(value, "")


def _in(value: Any, path: str) -> Iterator[str]:
    if isinstance(value, dict):
        if "kty" in value and "d" in value:
            yield join(path, "d")
        for name, inner in value.items():
            yield from _in(inner, join(path, name))
    elif isinstance(value, list):
        for n, inner in enumerate(value):
            yield from _in(inner, f"{path}[{n}]")
    elif isinstance(value, str) and any(map(_KEY.search, _as_bytes(value))):
        yield path


def _as_bytes(text: str) -> Iterator[bytes]:
    data = text.encode("utf-8", "surrogatepass")
    yield data
    try:
        yield base64.b64decode(data + b"==", altchars=b"-_" if set(text) & {"-", "_"} else None)
    except binascii.Error:
        return
