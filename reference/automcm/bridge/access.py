"""Who may connect to the bridge: loopback addresses and the token (docs/bridge.md, Security)."""

from __future__ import annotations

import hmac
import os
import re
from collections.abc import Iterable
from pathlib import Path

from automcm.links.link import LinkError, is_loopback
from automcm_spec.support import files

VARIABLE = "AUTOMCM_BRIDGE_TOKEN"
"""The environment variable of the token."""
_TOKEN = re.compile(r"[A-Za-z0-9._~+/=-]{16,256}")
_SCHEME = "Bearer"


def read_token(file: Path | None) -> str | None:
    """The token in ``file``, or without a file in the environment variable, or None.

    Raises LinkError, which names the source, but never its content, also if other users can read
    the file.
    """
    if file is None:
        return checked(os.environ[VARIABLE], VARIABLE) if VARIABLE in os.environ else None
    try:
        text = files.read_private(file, 1000).decode("ascii", errors="replace")
    except OSError as error:
        raise LinkError(f"{file}: {error.strerror or error}") from None
    return checked(text, str(file))


def checked(token: str, source: str) -> str:
    """The token without the white space around it.  Raises LinkError, which names ``source``."""
    if not _TOKEN.fullmatch(token.strip()):
        raise LinkError(
            f"{source}: a token must be 16 to 256 letters, digits or ._~+/=- "
            "(for example of: openssl rand -hex 32)"
        )
    return token.strip()


def check_listening(host: str, token: str | None, allow_remote: bool) -> None:
    """Raise LinkError if the bridge may not listen on ``host``."""
    if is_loopback(host):
        return
    if not allow_remote:
        raise LinkError(f"{host!r} is not a loopback address; allow_remote permits it")
    if token is None:
        raise LinkError(
            f"{host!r} is not a loopback address, so the bridge needs a token: "
            f"give --token-file or set {VARIABLE}"
        )


def authorization(token: str | None) -> dict[str, str]:
    """The HTTP headers of a client with this token."""
    return {} if token is None else {"Authorization": f"{_SCHEME} {token}"}


def authorized(headers: Iterable[str], token: str) -> bool:
    """Whether one of the Authorization headers has the token; compares in constant time."""
    given = (header.partition(" ") for header in headers)
    values = [value.strip() for scheme, _, value in given if scheme.lower() == _SCHEME.lower()]
    return any([_equal(value, token) for value in values])  # all, in constant time


def _equal(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(errors="surrogateescape"), token.encode())
