"""Signs what a station sends."""

from __future__ import annotations

from automcm.security import envelope
from automcm.security.certificates import Credentials

WHOLE_MS = 1000
"""The whole certificate is sent once in this time, and on request; else its digest."""


class PseudonymError(Exception):
    """The station id would change while the station is in a session."""


class Signer:
    """The credentials of a station, for messages in one codec."""

    def __init__(self, credentials: Credentials, codec: str) -> None:
        self._credentials, self._codec = credentials, codec
        self._whole_ms: int | None = None
        """When the whole certificate was sent last; None: it is due."""

    @property
    def credentials(self) -> Credentials:
        """The credentials with which it signs."""
        return self._credentials

    def sign(self, message: bytes, now_ms: int, wanted: bytes | None = None) -> bytes:
        """The message in an envelope, which asks for the certificate with the digest ``wanted``."""
        whole = self._whole_ms is None or now_ms - self._whole_ms >= WHOLE_MS
        if whole:
            self._whole_ms = now_ms
        return envelope.seal(
            self._credentials, self._codec, message, now_ms, whole=whole, wanted=wanted
        )

    def requested(self, digest: bytes) -> None:
        """Another station asks for the certificate with this digest."""
        if digest == self._credentials.certificate.digest:
            self._whole_ms = None

    def change(self, credentials: Credentials, *, in_use: int | None) -> None:
        """Sign with other credentials from now on.

        ``in_use`` is the station id while the station is bound or still sends a message of a
        session; then the new certificate must have that id too.  A session's id contains the id of
        its prescriber, and a station only believes the Fin, Cancel and CAM of the id that it knows
        as its peer (ACT-3, END-2, ACT-5: ``OfPeer``).  Raises PseudonymError.
        """
        if in_use is not None and in_use not in credentials.certificate.ids:
            raise PseudonymError(
                f"the new certificate does not have the id {in_use}, which is in a session"
            )
        self._credentials, self._whole_ms = credentials, None
