"""A link that signs what it sends and verifies what it receives, around any other link."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

from automcm.links.clock import Clock
from automcm.links.link import Link, Receiver
from automcm.security.signer import Signer
from automcm.security.verifier import Rejected, Verified, Verifier


class SecuredLink:
    """Carries envelopes over ``link`` (docs/secured.md).

    ``rejected`` is called with each datagram that is discarded; the service records it.
    """

    def __init__(self, link: Link, signer: Signer, verifier: Verifier, clock: Clock) -> None:
        self.signer, self.verifier = signer, verifier
        self.on_air = True
        """Whether the station sends.  If not, an envelope with its certificate is no copy of its
        own, but of another process with the same keys."""
        self.rejected: Callable[[Rejected], None] = lambda rejected: None
        self._link, self._clock = link, clock
        verifier.since_ms = clock.now()
        self._receive: Receiver = lambda data, tx: None

    def open(self, receive: Receiver) -> None:
        """As ``Link.open``."""
        self._receive = receive
        self._link.open(self._arrived)

    def send(self, data: bytes, to: int, tx: str) -> None:
        """As ``Link.send``."""
        sealed = self.signer.sign(data, self._clock.now(), self.verifier.wanted)
        self._link.send(sealed, to, tx)

    def close(self) -> None:
        """As ``Link.close``."""
        self._link.close()

    def _arrived(self, data: bytes, tx: str | None) -> int | None:
        """Pass on what is accepted.  Returns the sender of this datagram, if it is."""
        own = self.signer.credentials.certificate.digest if self.on_air else b""
        verdicts = self.verifier.receive(data, self._clock.now(), tx, own)
        with ExitStack() as stack:  # an exception of the application loses no other message
            for verdict in reversed(verdicts):
                stack.callback(self._take, verdict)
        last = verdicts[-1] if verdicts else None
        return last.src if isinstance(last, Verified) else None

    def _take(self, verdict: Verified | Rejected) -> None:
        if isinstance(verdict, Rejected):
            self.rejected(verdict)
            return
        if verdict.wanted is not None:
            self.signer.requested(verdict.wanted)
        self._receive(verdict.message, verdict.datagram.tx)
