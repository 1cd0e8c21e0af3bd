"""The cost of signed messages: bytes, signatures and verifications a second, latency.

The baselines are of the same run: ``openssl speed ecdsap256`` if OpenSSL is installed, and the bare
primitives of the package cryptography.  Rates are per second of CPU time, as those of OpenSSL;
latency is real time.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from itertools import count
from typing import Any

import numpy as np

from automcm.encoding.codec import FRAME_BYTES, JSON, codec
from automcm.security import certificates, cose, envelope
from automcm.security.certificates import Credentials
from automcm.security.signer import Signer
from automcm.security.verifier import Verified, Verifier
from automcm_evaluation.bandwidth import message_sizes as sizes
from automcm_spec.vocabulary.parameters import Parameters

NOW = 1_800_000_000_000
"""In ms; the sizes are those of our time."""
VEHICLES = (50, 200)
CAM_HZ = 10
CODECS = ("json", "uper")


@dataclass(frozen=True, slots=True)
class Bytes:
    """The bytes of a message, and those that an envelope adds with a digest or a certificate."""

    type: str
    points: int
    codec: str
    message: int
    digest: int
    certificate: int

    @property
    def fits(self) -> bool:
        """Whether it fits one frame with the whole certificate (KIN-2)."""
        return self.message + self.certificate <= FRAME_BYTES


@dataclass(frozen=True, slots=True)
class Rate:
    """Signatures and verifications a second on one core; None if it could not be measured."""

    name: str
    signatures: float | None
    verifications: float | None


@dataclass(frozen=True, slots=True)
class SecurityFigures:
    """All figures of one run."""

    certificate: int
    """The bytes of a certificate with one station id."""
    sizes: tuple[Bytes, ...]
    rates: tuple[Rate, ...]
    """A secured link with decoding, the envelope alone, and the baselines."""
    latency_us: dict[str, float]
    """Signing and verifying one message, at p50 and p99."""
    needed: dict[int, float]
    """For each number of vehicles at 10 Hz, the part of one core that verifies their CAMs."""

    def as_dict(self) -> dict[str, Any]:
        """The report for ``--json``."""
        return asdict(self)


def run(seconds: float, notify: Callable[[str], None] = lambda text: None) -> SecurityFigures:
    """Measure all figures in about ``seconds``."""
    own, authority = _station()
    notify("sizes")
    found = measured_sizes(own)
    notify("rates")
    link = _link(own, authority, seconds / 5)
    rates = [link, _envelope(own, seconds / 5), _primitives(own, seconds / 5)]
    notify("openssl")
    rates.append(_openssl(max(1, round(seconds / 10))))
    notify("latency")
    latency = _latency(own, authority, seconds / 5)
    assert link.verifications is not None
    needed = {n: n * CAM_HZ / link.verifications for n in VEHICLES}
    size = len(certificates.encoded(own.certificate))
    return SecurityFigures(size, found, tuple(rates), latency, needed)


def _station() -> tuple[Credentials, cose.PublicKey]:
    authority, key = cose.new_key(), cose.new_key()
    begin = NOW // 1000 - 3600
    certificate = certificates.issue(
        authority,
        key.public_key(),
        ids=[sizes.plain()[0].src],
        not_before=begin,
        not_after=begin + 7 * 86_400,
    )
    return Credentials(certificate, key), authority.public_key()


def measured_sizes(own: Credentials) -> tuple[Bytes, ...]:
    """Each message of docs/messages.md without a trajectory, and with the paper's."""
    messages = [(0, m) for m in sizes.plain()]
    messages += [(52, m) for m in sizes.carrying(sizes.trajectory(52))]
    found = []
    for points, message in messages:
        for name in CODECS:
            data = codec(name).encode(message)
            added = [
                len(envelope.seal(own, name, data, NOW, whole=whole)) - len(data)
                for whole in (False, True)
            ]
            found.append(Bytes(message.type, points, name, len(data), *added))
    return tuple(found)


def _cam(n: int) -> bytes:
    """A CAM of its own generation time, so that no envelope is a copy."""
    return JSON.encode(sizes.plain()[-1].model_copy(update={"generation_ms": NOW, "x_mm": n}))


def _verifier(own: Credentials, authority: cose.PublicKey) -> Verifier:
    """A verifier without a limit that knows the certificate."""
    verifier = Verifier([authority], JSON, Parameters(), per_second=10**9)
    first = envelope.seal(own, "json", _cam(-1), NOW, whole=True)
    assert isinstance(verifier.receive(first, NOW)[0], Verified)
    return verifier


def _cpu_us(call: Callable[[], object], seconds: float) -> float:
    """The CPU time of a call in microseconds: the least of at least three rounds of 100 calls."""
    best, end, rounds = np.inf, time.perf_counter() + seconds, 0
    while rounds < 3 or time.perf_counter() < end:
        began = time.process_time()
        for _ in range(100):
            call()
        best, rounds = min(best, (time.process_time() - began) / 100), rounds + 1
    return float(best) * 1e6


def _link(own: Credentials, authority: cose.PublicKey, seconds: float) -> Rate:
    """All that a secured link does for a CAM, its decoding included."""
    signer, message = Signer(own, "json"), _cam(0)
    sign = _cpu_us(lambda: signer.sign(message, NOW), seconds / 2)
    numbers, verifier = count(), _verifier(own, authority)
    sealed = [envelope.seal(own, "json", _cam(n), NOW, whole=False) for n in range(1000)]

    def verify() -> None:
        nonlocal verifier
        n = next(numbers) % len(sealed)
        if n == 0:
            verifier = _verifier(own, authority)  # the last one has seen all of them
        verifier.receive(sealed[n], NOW)

    return Rate("secured link", 1e6 / sign, 1e6 / _cpu_us(verify, seconds / 2))


def _envelope(own: Credentials, seconds: float) -> Rate:
    message = _cam(0)
    data, key = envelope.seal(own, "json", message, NOW, whole=False), own.key.public_key()
    sign = _cpu_us(lambda: envelope.seal(own, "json", message, NOW, whole=False), seconds / 2)
    verify = _cpu_us(lambda: cose.verify(envelope.read(data, "json").signed, key), seconds / 2)
    return Rate("envelope alone", 1e6 / sign, 1e6 / verify)


def _primitives(own: Credentials, seconds: float) -> Rate:
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec

    message, algorithm = _cam(0), ec.ECDSA(hashes.SHA256())
    signature, key = own.key.sign(message, algorithm), own.key.public_key()
    sign = _cpu_us(lambda: own.key.sign(message, algorithm), seconds / 2)
    verify = _cpu_us(lambda: key.verify(signature, message, algorithm), seconds / 2)
    return Rate("cryptography", 1e6 / sign, 1e6 / verify)


def _openssl(seconds: int) -> Rate:
    """The last line of ``openssl speed`` ends with signatures and verifications a second."""
    program = shutil.which("openssl")
    if program is None:
        return Rate("openssl: not installed", None, None)
    command = [program, "speed", "-seconds", str(seconds), "ecdsap256"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60 + 4 * seconds)
    row = re.search(r"ecdsa \(nistp256\).* ([\d.]+) +([\d.]+)\s*$", done.stdout)
    if row is None:
        return Rate("openssl: no figures", None, None)
    return Rate("openssl speed", float(row[1]), float(row[2]))


def _latency(own: Credentials, authority: cose.PublicKey, seconds: float) -> dict[str, float]:
    verifier, signer, spent = _verifier(own, authority), Signer(own, "json"), []
    n, end = 0, time.perf_counter() + seconds
    while n < 100 or time.perf_counter() < end:
        message = _cam(n)
        began = time.perf_counter()
        verifier.receive(signer.sign(message, NOW), NOW)
        spent.append((time.perf_counter() - began) * 1e6)
        n += 1
    return {f"p{q}": float(np.percentile(spent, q)) for q in (50, 99)}
