"""Finds private keys in a record of a log: as PEM, as JWK, and in base64 as DER or COSE_Key."""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Iterator
from typing import Any, Final

from automcm_spec.log_format.problems import join

_PEM: Final = re.compile(rb"-----BEGIN [A-Z ]*PRIVATE KEY-----")
_DER: Final = re.compile(rb"\x02\x01\x01\x04\x20")
"""An ECPrivateKey (RFC 5915) begins with its version and 32 bytes."""
_COSE: Final = re.compile(
    rb"\x20\x01(\x21\x58\x20.{32})?(\x22(\x58\x20.{32}|[\xf4\xf5]))?\x23\x58\x20", re.S
)
"""In a COSE_Key (RFC 9053, 7.1), after the curve and the public key, label -4: d."""
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
    elif isinstance(value, str) and any(map(_is_key, _as_bytes(value))):
        yield path


def _as_bytes(text: str) -> Iterator[bytes]:
    data = text.encode("utf-8", "surrogatepass")
    yield data
    try:
        yield base64.b64decode(data + b"==", altchars=b"-_" if set(text) & {"-", "_"} else None)
    except binascii.Error:
        return


def _is_key(data: bytes) -> bool:
    return any(form.search(data) for form in (_PEM, _DER, _COSE))
