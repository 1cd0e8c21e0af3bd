"""The envelope: one encoded message with its generation time, signed by its sender.

The signed payload is ``[generation_ms, message]`` or ``[generation_ms, message, digest]``, where
the digest asks for that certificate.  The header has the signer's certificate or its digest.  The
type of the message is not repeated: it is in the message.  The codec is in the context, so that no
bytes can be read by another codec than they were written for.
"""

from __future__ import annotations

from dataclasses import dataclass

from automcm.security import certificates, cose
from automcm.security.certificates import DIGEST_BYTES, Certificate, Credentials
from automcm.security.cose import Malformed

CONTEXT = b"automcm.envelope/1 "


@dataclass(frozen=True, slots=True)
class Envelope:
    """An envelope whose signature is not verified yet."""

    signer: bytes
    """The digest of the signer's certificate."""
    certificate: Certificate | None
    """The certificate, if the envelope has the whole one."""
    generation_ms: int
    """UNIX time in ms."""
    message: bytes
    wanted: bytes | None
    """The digest of a certificate that its sender asks for."""
    signed: cose.Signed


def seal(
    credentials: Credentials,
    codec: str,
    message: bytes,
    generation_ms: int,
    *,
    whole: bool,
    wanted: bytes | None = None,
) -> bytes:
    """An envelope with the whole certificate or only its digest."""
    own = credentials.certificate
    header = {cose.KCWT: own.encoded} if whole else {cose.KID: own.digest}
    content = [generation_ms, message] if wanted is None else [generation_ms, message, wanted]
    return cose.sign(credentials.key, header, cose.encode(content), CONTEXT + codec.encode())


def read(data: bytes, codec: str) -> Envelope:
    """An envelope, before its verification.  Raises Malformed."""
    signed = cose.read(data, CONTEXT + codec.encode())
    certificate: Certificate | None = None
    match signed.header:
        case {cose.KCWT: value}:
            certificate = certificates.unpacked(value)
            signer = certificate.digest
        case {cose.KID: bytes() as signer}:
            pass
        case _:
            raise Malformed("the header names no signer")
    if len(signed.header) != 1 or len(signer) != DIGEST_BYTES:
        raise Malformed("the header must have a certificate or a digest of 8 bytes")
    wanted: bytes | None = None
    match cose.short_list(signed.payload):
        case [int() as generation_ms, bytes() as message]:
            pass
        case [int() as generation_ms, bytes() as message, bytes() as wanted]:
            pass
        case _:
            raise Malformed("not a generation time and a message")
    if wanted is not None and len(wanted) != DIGEST_BYTES:
        raise Malformed("the wanted digest must have 8 bytes")
    return Envelope(signer, certificate, generation_ms, message, wanted, signed)
