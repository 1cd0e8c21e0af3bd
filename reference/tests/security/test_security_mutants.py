"""The checks bite: each function of the verifier with one thing changed must fail a test.

The changed function takes the place of the one in its module.
"""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Callable
from typing import Any

import pytest
import test_security_limits as limits
import test_security_verifier as checks

from automcm.security import budget, certificates, cose, envelope, signer, verifier

VERIFIER = verifier.Verifier
JUDGE, READ, ADMIT = "_judge", "_read", "_admit"
# where, the function, old text, new text
MUTANTS: list[tuple[Any, str, str, str]] = [
    (VERIFIER, READ, "len(data) > MAX_BYTES", "False"),
    (VERIFIER, READ, "self._check_age(read.generation_ms, now_ms)", "pass"),
    (VERIFIER, READ, "self._check_replay(read)", "pass"),
    (VERIFIER, "_check_age", "now_ms - generation_ms > self._window", "False"),
    (VERIFIER, "_check_age", "> self._window", ">= self._window"),
    (VERIFIER, "_check_age", "generation_ms - now_ms > CLOCK_MS", "False"),
    (VERIFIER, "_check_age", "> CLOCK_MS", ">= CLOCK_MS"),
    (VERIFIER, "receive", "read.signer == own", "False"),
    (VERIFIER, "receive", "self._admit(read, now_ms)", "self._known[read.signer] = "
     "(read.certificate, read.certificate.key())"),
    (VERIFIER, "receive", "out += self._had_waited_for(read.signer, now_ms)", "pass"),
    (VERIFIER, "receive", "out = self._no_longer_waiting(now_ms)", "out = []"),
    (VERIFIER, "_check_certificate", "now_ms >= certificate.not_after * 1000", "False"),
    (VERIFIER, "_check_certificate", ">= certificate.not_after", "> certificate.not_after"),
    (VERIFIER, "_check_certificate", "now_ms < certificate.not_before * 1000", "False"),
    (VERIFIER, "_check_certificate", "in revoked.digests", "in ()"),
    (VERIFIER, ADMIT, "authority is None", "False"),
    (VERIFIER, ADMIT, "self._authorities.get(certificate.authority)",
     "next(iter(self._authorities.values()))"),
    (VERIFIER, ADMIT, "not self._budget.spend(2, now_ms)", "False"),
    (VERIFIER, ADMIT, "self._budget.spend(2, now_ms)",
     "self._budget.spend(self.ranking(certificate.ids), now_ms)"),
    (VERIFIER, ADMIT, "not cose.verify(certificate.signed, authority)", "False"),
    (VERIFIER, ADMIT, "len(self._known) > CERTIFICATES", "False"),
    (VERIFIER, "_wait", "full[:1] if full is of_one or len(full) >= WAITING else []", "[]"),
    (VERIFIER, "_wait", "len(of_one) >= WAITING_OF_ONE", "False"),
    (VERIFIER, "_had_waited_for", "self._check_replay(read)", "pass"),
    (VERIFIER, "_had_waited_for", "each[0].signer == signer", "True"),
    (VERIFIER, JUDGE, "self._check_certificate(certificate, now_ms)", "pass"),
    (VERIFIER, JUDGE, "not self._budget.spend(self.ranking(certificate.ids), now_ms)", "False"),
    (VERIFIER, JUDGE, "not cose.verify(read.signed, key)", "False"),
    (VERIFIER, JUDGE, "self._known.move_to_end(read.signer)", "pass"),
    (VERIFIER, JUDGE, "self._remember(read, now_ms)", "pass"),
    (VERIFIER, JUDGE, "message.src not in certificate.ids", "False"),
    (VERIFIER, JUDGE, "not certificate.permits(message)", "False"),
    (VERIFIER, JUDGE, "isinstance(message, Cam)", "False"),
    (VERIFIER, "_remember", "(p + 2) * self._window < now_ms", "p * self._window < now_ms"),
    (VERIFIER, "_remember", "(p + 2) * self._window < now_ms", "False"),
    (VERIFIER, "revoke", "authority is None or", ""),
    (VERIFIER, "revoke", "new.issued <= present.issued", "False"),
    (VERIFIER, "revoke", "not cose.verify(new.signed, authority)", "False"),
    (verifier, "_identity", "read.signer + read.signed.payload", "read.signed.signature"),
    (verifier, "_identity", "read.signer + read.signed.payload", "read.signer"),
    (verifier, "freshness_ms", "- CLOCK_MS", "+ CLOCK_MS"),
    (verifier, "freshness_ms", "window < (least", "0 > (least"),
    (cose, "verify", "s > ORDER // 2", "False"),
    (cose, "short_list", "encode(items) != data", "False"),
    (cose, "decode", "with_map and len(data) > MAP_BYTES", "False"),
    (cose, "decode", "not with_map", "False"),
    (cose, "unpacked", "if unprotected or ", "if "),
    (cose, "unpacked", "header.pop(ALGORITHM, None) != ES256", "not header.pop(ALGORITHM, 0)"),
    (cose, "_content", '"Signature1", protected, context', '"Signature1", protected, b""'),
    (cose, "_content", '"Signature1", protected, context', '"Signature1", b"", context'),
    (cose, "_content", "context, payload]", "context, payload[:-1]]"),
    (envelope, "read", "len(signed.header) != 1 or ", ""),
    (envelope, "read", "len(wanted) != DIGEST_BYTES", "False"),
    (certificates.Certificate, "permits", "and message.scenario in self.scenarios", ""),
    (certificates.Certificate, "permits", 'return "prescriber" in self.roles and', "return"),
    (certificates, "needed", '"Advertisement" | "Prescription" | "Fin"', '"Prescription" | "Fin"'),
    (certificates, "needed", "message.session[0] == message.src", "True"),
    (certificates, "unpacked", "len(data) > CERTIFICATE_BYTES", "False"),
    (certificates, "unpacked", "and _ascending(ids, int)", ""),
    (budget.Budget, "spend", "max(1000, full * _RESERVED[rank])", "1000"),
    (budget.Budget, "spend", "min(full, ", "max(0, "),
    (signer.Signer, "change", "in_use not in credentials.certificate.ids", "False"),
    (signer.Signer, "change", ", None", ", 10**15"),
    (signer.Signer, "sign", ">= WHOLE_MS", ">= 2 * WHOLE_MS"),
    (signer.Signer, "requested", "digest == self._credentials.certificate.digest", "True"),
]  # fmt: skip
SLOW = ("thousand", "changed_byte")
TESTS = [
    each
    for module in (checks, limits)
    for name, each in vars(module).items()
    if name.startswith("test_")
]
TESTS.sort(key=lambda each: any(part in each.__name__ for part in SLOW))


def mutated(where: Any, name: str, old: str, new: str) -> Any:
    """The function with another text, in the namespace of its module."""
    function = inspect.getattr_static(where, name)
    source = textwrap.dedent(inspect.getsource(function))
    assert old in source, f"{name}: {old!r} is not there"
    made: dict[str, Any] = {}
    exec(compile(source.replace(old, new), f"<{name} mutated>", "exec"), function.__globals__, made)
    return made[name]


@pytest.mark.sweep(8)
@pytest.mark.parametrize(
    ("where", "name", "old", "new"), MUTANTS, ids=[f"{m[1]}-{n}" for n, m in enumerate(MUTANTS)]
)
def test_is_caught(
    where: Any, name: str, old: str, new: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(where, name, mutated(where, name, old, new))
    assert any(_fails(test) for test in TESTS), f"{name}: {old!r} for {new!r} passes every test"


def _fails(test: Callable[[], None]) -> bool:
    try:
        test()
    except Exception:
        return True
    return False


def test_without_a_mutation_every_test_passes() -> None:
    assert not [test.__name__ for test in TESTS if _fails(test)]
