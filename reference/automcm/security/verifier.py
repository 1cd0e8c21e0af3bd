"""Verifies what a station receives; docs/secured.md has the reasons in the order of the checks.

The checks that cost little come first, so that a flood of copies or of old messages costs no
verification of a signature.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from automcm.encoding.codec import Codec
from automcm.security import certificates, cose, envelope
from automcm.security.budget import PER_SECOND, Budget, Ranking
from automcm.security.certificates import Certificate
from automcm.security.cose import Malformed, PublicKey
from automcm.security.envelope import Envelope
from automcm_spec.vocabulary.messages import MAX_BYTES, Cam, Message, MessageError
from automcm_spec.vocabulary.parameters import CLOCK_MS, ParameterError, Parameters, longest_delay

CERTIFICATES = 256
WAITING = 32
"""Maximum number of messages that wait for the certificate of their signer."""
WAITING_OF_ONE = 8


class Rejection(StrEnum):
    """Why a datagram is discarded, in the order of the checks."""

    TOO_LONG = "too_long"
    MALFORMED = "malformed"
    STALE = "stale"
    EARLY = "early"
    REPLAYED = "replayed"
    UNKNOWN_SIGNER = "unknown_signer"
    UNKNOWN_AUTHORITY = "unknown_authority"
    CERTIFICATE_EXPIRED = "certificate_expired"
    CERTIFICATE_NOT_YET = "certificate_not_yet"
    REVOKED = "revoked"
    OVER_BUDGET = "over_budget"
    BAD_SIGNATURE = "bad_signature"
    WRONG_SOURCE = "wrong_source"
    NOT_PERMITTED = "not_permitted"


@dataclass(frozen=True, slots=True)
class Datagram:
    """A received datagram, with its transmission id if known."""

    data: bytes
    tx: str | None = None


@dataclass(frozen=True, slots=True)
class Verified:
    """A message whose sender is known and permitted to send it."""

    message: bytes
    src: int
    wanted: bytes | None
    """The digest of a certificate that its sender asks for."""
    datagram: Datagram


@dataclass(frozen=True, slots=True)
class Rejected:
    """A datagram without effect; ``src`` if its message was read, which may be forged."""

    reason: Rejection
    src: int | None
    datagram: Datagram


class _Refused(Exception):
    def __init__(self, reason: Rejection, src: int | None = None) -> None:
        super().__init__(reason)
        self.reason, self.src = reason, src


def freshness_ms(parameters: Parameters) -> int:
    """The greatest age of an envelope on the receiver's clock.

    A message is signed anew at each sending, up to ``t_giveup - t_resend`` after the first.  No
    copy may arrive later than ``t_life`` after the first sending (section 3, note 2), although the
    two clocks may differ by CLOCK_MS.  Raises ParameterError if an honest copy could be too old.
    """
    p = parameters
    window = p.t_life - (p.t_giveup - p.t_resend) - CLOCK_MS
    if window < (least := longest_delay(p.known) + CLOCK_MS):
        raise ParameterError(
            f"t_timeout: with signed messages, t_life must leave copies {least} ms to arrive,"
            f" not {window} ms; increase t_timeout"
        )
    return window


class Verifier:
    """What a station knows of others: authorities, certificates, and which messages it has seen.

    All of it is bounded.  ``ranking`` ranks station ids for the budget of verifications; the
    service replaces it.
    """

    def __init__(
        self,
        authorities: Iterable[PublicKey],
        codec: Codec,
        parameters: Parameters,
        *,
        per_second: int = PER_SECOND,
    ) -> None:
        self.ranking: Ranking = lambda ids: 2
        self.since_ms = 0
        """What was generated before is stale: a former process may have received or sent it."""
        self._authorities = {certificates.authority_digest(key): key for key in authorities}
        self._codec = codec
        self._window = freshness_ms(parameters)
        self._budget = Budget(per_second)
        self._known: OrderedDict[bytes, tuple[Certificate, PublicKey]] = OrderedDict()
        """The certificates that were verified, the least recently used first."""
        self._revoked: dict[bytes, certificates.Revocations] = {}
        self._waiting: list[tuple[Envelope, Datagram]] = []
        self._seen: dict[int, set[bytes]] = {}
        """Of each verified message a hash, by its generation time in multiples of the window; at
        most the budget of three windows."""

    @property
    def wanted(self) -> bytes | None:
        """The digest of a certificate that a message waits for, to be asked for."""
        return self._waiting[-1][0].signer if self._waiting else None

    def revoke(self, data: bytes) -> bool:
        """Take a list of revoked certificates.

        Returns whether an authority has signed it and it is newer than the present one.
        """
        try:
            new = certificates.read_revocations(data)
        except Malformed:
            return False
        authority, present = self._authorities.get(new.authority), self._revoked.get(new.authority)
        if authority is None or (present is not None and new.issued <= present.issued):
            return False
        if not cose.verify(new.signed, authority):
            return False
        self._revoked[new.authority] = new
        return True

    def problem(self, certificate: Certificate, now_ms: int) -> Rejection | None:
        """Why every message with this certificate is discarded; None if it is valid."""
        authority = self._authorities.get(certificate.authority)
        if authority is None:
            return Rejection.UNKNOWN_AUTHORITY
        try:
            self._check_certificate(certificate, now_ms)
        except _Refused as refused:
            return refused.reason
        return None if cose.verify(certificate.signed, authority) else Rejection.BAD_SIGNATURE

    def receive(
        self, data: bytes, now_ms: int, tx: str | None = None, own: bytes = b""
    ) -> list[Verified | Rejected]:
        """Judge a datagram; ``own`` is the digest of the station's own certificate.

        A message of an unknown signer waits for its certificate and is judged when that arrives, or
        too late.  So the result may have earlier datagrams; this one is the last, or waits.
        """
        out = self._no_longer_waiting(now_ms)
        datagram = Datagram(data, tx)
        try:
            read = self._read(data, now_ms)
            if read.signer == own:
                raise _Refused(Rejection.REPLAYED)
            if read.certificate is None and read.signer not in self._known:
                return out + self._wait(read, datagram)
            if read.signer not in self._known:
                self._admit(read, now_ms)
                out += self._had_waited_for(read.signer, now_ms)
            return [*out, self._judge(read, datagram, now_ms)]
        except _Refused as refused:
            return [*out, Rejected(refused.reason, refused.src, datagram)]

    # -- without a signature

    def _read(self, data: bytes, now_ms: int) -> Envelope:
        if len(data) > MAX_BYTES:
            raise _Refused(Rejection.TOO_LONG)
        try:
            read = envelope.read(data, self._codec.name)
        except Malformed:
            raise _Refused(Rejection.MALFORMED) from None
        self._check_age(read.generation_ms, now_ms)
        self._check_replay(read)
        return read

    def _check_age(self, generation_ms: int, now_ms: int, src: int | None = None) -> None:
        if now_ms - generation_ms > self._window or generation_ms < self.since_ms:
            raise _Refused(Rejection.STALE, src)
        if generation_ms - now_ms > CLOCK_MS:
            raise _Refused(Rejection.EARLY, src)

    def _check_replay(self, read: Envelope) -> None:
        if _identity(read) in self._seen.get(read.generation_ms // self._window, ()):
            raise _Refused(Rejection.REPLAYED)

    # -- certificates

    def _check_certificate(self, certificate: Certificate, now_ms: int) -> None:
        if now_ms >= certificate.not_after * 1000:
            raise _Refused(Rejection.CERTIFICATE_EXPIRED)
        if now_ms < certificate.not_before * 1000:
            raise _Refused(Rejection.CERTIFICATE_NOT_YET)
        revoked = self._revoked.get(certificate.authority)
        if revoked is not None and certificate.digest in revoked.digests:
            raise _Refused(Rejection.REVOKED)

    def _admit(self, read: Envelope, now_ms: int) -> None:
        """Keep a certificate that a known authority has signed."""
        certificate = read.certificate
        assert certificate is not None
        authority = self._authorities.get(certificate.authority)
        if authority is None:
            raise _Refused(Rejection.UNKNOWN_AUTHORITY)
        self._check_certificate(certificate, now_ms)
        if not self._budget.spend(2, now_ms):  # its ids are only claimed
            raise _Refused(Rejection.OVER_BUDGET)
        if not cose.verify(certificate.signed, authority):
            raise _Refused(Rejection.BAD_SIGNATURE)
        try:
            self._known[certificate.digest] = certificate, certificate.key()
        except Malformed:
            raise _Refused(Rejection.MALFORMED) from None
        if len(self._known) > CERTIFICATES:
            self._known.popitem(last=False)

    def _wait(self, read: Envelope, datagram: Datagram) -> list[Verified | Rejected]:
        """Let a message wait for a certificate, in place of an older one if too many do."""
        of_one = [each for each in self._waiting if each[0].signer == read.signer]
        full = of_one if len(of_one) >= WAITING_OF_ONE else self._waiting
        dropped = full[:1] if full is of_one or len(full) >= WAITING else []
        self._waiting.append((read, datagram))
        for each in dropped:
            self._waiting.remove(each)
        return [Rejected(Rejection.UNKNOWN_SIGNER, None, oldest) for _, oldest in dropped]

    def _no_longer_waiting(self, now_ms: int) -> list[Verified | Rejected]:
        """The messages that have waited until they were too old."""
        oldest = now_ms - self._window
        late = [each for read, each in self._waiting if read.generation_ms < oldest]
        self._waiting = [each for each in self._waiting if each[0].generation_ms >= oldest]
        return [Rejected(Rejection.UNKNOWN_SIGNER, None, each) for each in late]

    def _had_waited_for(self, signer: bytes, now_ms: int) -> list[Verified | Rejected]:
        """Judge the messages that waited for this certificate, in the order of their arrival."""
        ready = [each for each in self._waiting if each[0].signer == signer]
        self._waiting = [each for each in self._waiting if each[0].signer != signer]
        out: list[Verified | Rejected] = []
        for read, datagram in ready:
            try:
                self._check_replay(read)  # two copies may have waited
                out.append(self._judge(read, datagram, now_ms))
            except _Refused as refused:
                out.append(Rejected(refused.reason, refused.src, datagram))
        return out

    # -- with a signature

    def _judge(self, read: Envelope, datagram: Datagram, now_ms: int) -> Verified:
        certificate, key = self._known[read.signer]
        self._check_certificate(certificate, now_ms)
        if not self._budget.spend(self.ranking(certificate.ids), now_ms):
            raise _Refused(Rejection.OVER_BUDGET)
        if not cose.verify(read.signed, key):
            raise _Refused(Rejection.BAD_SIGNATURE)
        self._known.move_to_end(read.signer)
        self._remember(read, now_ms)
        message = self._decoded(read)
        if message.src not in certificate.ids:
            raise _Refused(Rejection.WRONG_SOURCE, message.src)
        if not certificate.permits(message):
            raise _Refused(Rejection.NOT_PERMITTED, message.src)
        if isinstance(message, Cam):
            self._check_age(message.generation_ms, now_ms, message.src)
        return Verified(read.message, message.src, read.wanted, datagram)

    def _decoded(self, read: Envelope) -> Message | Cam:
        """The message.  It is decoded as by the station, which does so again: another, quicker
        decoder could read another ``src``."""
        try:
            return self._codec.decode(read.message)
        except MessageError:
            raise _Refused(Rejection.MALFORMED) from None

    def _remember(self, read: Envelope, now_ms: int) -> None:
        """Keep what ``_check_replay`` needs, while the message is not stale."""
        for period in [p for p in self._seen if (p + 2) * self._window < now_ms]:
            del self._seen[period]
        self._seen.setdefault(read.generation_ms // self._window, set()).add(_identity(read))


def _identity(read: Envelope) -> bytes:
    """The hash of what was signed, by whom and when.  The signature is not a part of it, because
    its holder can sign the same content twice."""
    return hashlib.sha256(read.signer + read.signed.payload).digest()[:16]
