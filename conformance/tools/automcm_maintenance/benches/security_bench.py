"""The cost of signed messages: bytes, signatures and verifications, beside the bare primitives."""

from __future__ import annotations

from itertools import count

import pytest

pytest.importorskip("cryptography")
pytest.importorskip("cbor2")

from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec

from automcm.encoding.codec import JSON, NAMES, codec
from automcm.security import certificates, cose, envelope
from automcm.security.certificates import Credentials
from automcm.security.signer import Signer
from automcm.security.verifier import Verified, Verifier
from automcm_evaluation.bandwidth import message_sizes as sizes
from automcm_maintenance.benches.plugin import Figure, Timed, beside
from automcm_spec.vocabulary.parameters import Parameters

NOW = 1_800_000_000_000
"""In ms; the sizes are those of our time."""
AUTHORITY = cose.new_key()
ALGORITHM = ec.ECDSA(hashes.SHA256())


def station() -> Credentials:
    """A station with a certificate of AUTHORITY for a week."""
    key, begin = cose.new_key(), NOW // 1000 - 3600
    issued = certificates.issue(
        AUTHORITY,
        key.public_key(),
        ids=[sizes.plain()[0].src],
        not_before=begin,
        not_after=begin + 7 * 86_400,
    )
    return Credentials(issued, key)


OWN = station()


def cam(n: int = 0) -> bytes:
    """A CAM of its own, so that no envelope is a copy."""
    return JSON.encode(sizes.plain()[-1].model_copy(update={"generation_ms": NOW, "x_mm": n}))


def sealed(n: int, *, whole: bool = False) -> bytes:
    """A signed CAM."""
    return envelope.seal(OWN, "json", cam(n), NOW, whole=whole)


def added(*, whole: bool) -> list[int]:
    """The bytes that an envelope adds to each message of docs/messages.md, in each codec."""
    messages = [*sizes.plain(), *sizes.carrying(sizes.trajectory(52))]
    encoded = [(name, codec(name).encode(each)) for each in messages for name in NAMES]
    return [len(envelope.seal(OWN, n, data, NOW, whole=whole)) - len(data) for n, data in encoded]


@pytest.mark.parametrize("whole", [False, True], ids=["digest", "certificate"])
@beside("plain_bytes", 3)
def bench_bytes(whole: bool, figure: Figure) -> None:
    """Of a signed CAM in JSON."""
    figure(len(sealed(0, whole=whole)), "bytes")


def bench_plain_bytes(figure: Figure) -> None:
    """Of a CAM."""
    figure(len(cam()), "bytes")


def bench_primitive_sign(timed: Timed) -> None:
    """The package cryptography alone."""
    message = cam()
    timed(lambda: OWN.key.sign(message, ALGORITHM))


def bench_primitive_verify(timed: Timed) -> None:
    """The package cryptography alone."""
    message, key = cam(), OWN.key.public_key()
    signature = OWN.key.sign(message, ALGORITHM)
    timed(lambda: key.verify(signature, message, ALGORITHM))


@beside("primitive_sign", 2)
def bench_envelope_sign(timed: Timed) -> None:
    """The envelope alone."""
    message = cam()
    timed(lambda: envelope.seal(OWN, "json", message, NOW, whole=False))


@beside("primitive_verify", 2)
def bench_envelope_verify(timed: Timed) -> None:
    """The envelope alone."""
    data, key = sealed(0), OWN.key.public_key()
    timed(lambda: cose.verify(envelope.read(data, "json").signed, key))


@beside("primitive_sign", 2.5)
def bench_link_sign(timed: Timed) -> None:
    """All that a secured link does for a CAM."""
    signer, message = Signer(OWN, "json"), cam()
    timed(lambda: signer.sign(message, NOW))


@beside("primitive_verify", 2.5)
def bench_link_verify(timed: Timed) -> None:
    """All that a secured link does for a CAM, its decoding included."""
    numbers, data = count(), [sealed(n) for n in range(1000)]
    first, verifier = sealed(-1, whole=True), None

    def verify() -> None:
        nonlocal verifier
        n = next(numbers) % len(data)
        if verifier is None or n == 0:  # the last one has seen all of them
            authorities = [AUTHORITY.public_key()]
            verifier = Verifier(authorities, JSON, Parameters(), per_second=10**9)
            assert isinstance(verifier.receive(first, NOW)[0], Verified)
        verifier.receive(data[n], NOW)

    timed(verify)
