"""The bugs that the vectors for signed messages name, each as edits of the reference."""

from __future__ import annotations

import inspect
import textwrap
from typing import Any

from cose_maker import compressed

from automcm.security import certificates, cose, envelope, verifier

Edit = tuple[Any, str, str, str]
"""A module or class, the name of its function, an old text and the new one."""

V = verifier.Verifier
READ, JUDGE, ADMIT, CHECK = "_read", "_judge", "_admit", "_check_certificate"
BOUNDS = (certificates, "unpacked")
PERMITS = (certificates.Certificate, "permits")

OTHER_ENCODINGS = [(cose, "decode", "or encode(value) != data", "")]
BASE = f"bytes.fromhex({compressed(1).hex()!r})"
UNSIGNED_HEADER = [
    (cose, "unpacked", "if unprotected or ", "if "),
    (cose, "decode", "not with_map", "False"),
]
ANY_ALGORITHM = [
    (cose, "unpacked", "header.pop(ALGORITHM, None) != ES256", "not header.pop(ALGORITHM, ES256)")
]

EDITS: dict[str, dict[str, list[Edit]]] = {
    "certificate": {
        "digest-of-the-first-bytes": [(certificates, "digest", "[-DIGEST_BYTES:]",
            "[:DIGEST_BYTES]")],
        "scenarios-ignored": [(*BOUNDS, "claims.get(_SCENARIOS)", "None")],
        "fewer-ids": [(*BOUNDS, "len(ids) <= MAX_IDS", "len(ids) < MAX_IDS")],
        "any-number-of-ids": [(*BOUNDS, "0 < len(ids) <= MAX_IDS", "ids")],
        "no-id": [(*BOUNDS, "0 < len(ids) <= MAX_IDS", "len(ids) <= MAX_IDS"),
            (*BOUNDS, "0 < ids[0] <= ids[-1] < 2**32", "all(0 < each < 2**32 for each in ids)")],
        "ids-in-any-order": [(*BOUNDS, "and _ascending(ids, int)", "")],
        "id-zero": [(*BOUNDS, "0 < ids[0]", "0 <= ids[0]")],
        "id-of-33-bits": [(*BOUNDS, "< 2**32", "< 2**33")],
        "empty-validity": [(*BOUNDS, "_number(not_before) < _number(not_after)",
            "not_before <= not_after")],
        "endless-validity": [(*BOUNDS, "< 2**40", "<= 2**40")],
        "roles-in-another-order": [(*BOUNDS, "roles >> n & 1", "roles >> len(ROLES) - 1 - n & 1")],
        "no-role": [(*BOUNDS, "0 < _number(roles)", "0 <= _number(roles)")],
        "unknown-role": [(*BOUNDS, "< 1 << len(ROLES)", "< 256")],
        "station-type-of-9-bits": [(*BOUNDS, "< 256", "< 512")],
        "missing-claim-assumed": [(*BOUNDS, "_map(cose.decode(signed.payload, with_map=True),",
            "_map({_STATION_TYPE: 5} | cose.decode(signed.payload, with_map=True),")],
        "unknown-claim-ignored": [(*BOUNDS, "{_SCENARIOS})", "{_SCENARIOS, -65541})")],
        "scenarios-in-any-order": [(*BOUNDS, "or _ascending(scenarios, str)", "or True")],
        "y-as-number": [(*BOUNDS, "(type(x), type(odd), type(authority)) == (bytes, bool, bytes)",
            "type(x) is type(authority) is bytes")],
        "any-curve": [(*BOUNDS, "_number(key[_CRV])", "_P256")],
        "authority-of-any-length": [(*BOUNDS, "(len(x), len(authority)) == (32, DIGEST_BYTES)",
            "len(x) == 32")],
        "too-long": [(*BOUNDS, "len(data) > CERTIFICATE_BYTES", "False")],
        "other-encodings": OTHER_ENCODINGS,
        "unsigned-header": UNSIGNED_HEADER,
        "algorithm-not-compared": ANY_ALGORITHM,
        "any-point": [(certificates.Certificate, "key", "self.point", BASE)],
        "short-signature": [(cose, "unpacked", "len(signature) != 64", "False")],
    },
    "envelope": {
        "other-external-data": [(envelope, "read",
            "CONTEXT + codec.encode()", 'CONTEXT + b"uper"')],
        "unknown-signer-dropped": [(V, "receive", "return out + self._wait(read, datagram)",
            "return out")],
        "unknown-signer-accepted": [(V, "receive", "return out + self._wait(read, datagram)",
            "return [*out, Verified(read.message, 9, None, datagram)]")],
        "waiting-not-compared": [(V, "_had_waited_for", "self._check_replay(read)", "pass")],
        "waiting-forever": [(V, "receive", "self._no_longer_waiting(now_ms)", "[]")],
        "waiting-unbounded": [(V, "_wait", "len(of_one) >= WAITING_OF_ONE", "False")],
        "request-ignored": [(V, JUDGE, "read.wanted", "None")],
        "signature-not-checked": [(V, JUDGE, "not cose.verify(read.signed, key)", "False")],
        "certificate-signature-not-checked": [(V, ADMIT,
            "not cose.verify(certificate.signed, authority)", "False")],
        "replay-not-checked": [(V, READ, "self._check_replay(read)", "pass")],
        "replay-by-signature": [(verifier, "_identity", "read.signer + read.signed.payload",
            "read.signed.signature")],
        "replay-by-content": [(verifier, "_identity", "read.signer + ", "")],
        "replay-forgotten": [(V, "_remember", "(p + 2) * self._window", "p * self._window")],
        "forged-remembered": [(V, JUDGE, "if not cose.verify(read.signed, key)",
            "self._remember(read, now_ms)\n    if not cose.verify(read.signed, key)")],
        "age-not-checked": [(V, "_check_age", "now_ms - generation_ms > self._window", "False")],
        "age-bound": [(V, "_check_age", "> self._window", ">= self._window")],
        "future-not-checked": [(V, "_check_age", "generation_ms - now_ms > CLOCK_MS", "False")],
        "future-bound": [(V, "_check_age", "> CLOCK_MS", ">= CLOCK_MS")],
        "cam-time-not-checked": [(V, JUDGE, "isinstance(message, Cam)", "False")],
        "own-message": [(V, "receive", "read.signer == own", "False")],
        "any-authority": [(V, ADMIT, "authority is None", "False"),
            (V, ADMIT, "not cose.verify(", "authority and not cose.verify(")],
        "first-authority": [(V, ADMIT, "self._authorities.get(certificate.authority)",
            "next(iter(self._authorities.values()))")],
        "end-not-checked": [(V, CHECK, "now_ms >= certificate.not_after * 1000", "False")],
        "end-bound": [(V, CHECK, ">= certificate.not_after", "> certificate.not_after")],
        "end-too-early": [(V, CHECK, "now_ms >=", "now_ms + 1000 >=")],
        "beginning-not-checked": [(V, CHECK, "now_ms < certificate.not_before * 1000", "False")],
        "beginning-bound": [(V, CHECK, "< certificate.not_before", "<= certificate.not_before")],
        "certificate-checked-once": [(V, JUDGE, "self._check_certificate(certificate, now_ms)",
            "pass")],
        "revocation-not-checked": [(V, CHECK, "in revoked.digests", "in ()")],
        "any-list": [(V, "revoke", "authority is None or ", ""),
            (V, "revoke", "not cose.verify(new.signed, authority)", "False")],
        "older-list": [(V, "revoke", "new.issued <= present.issued", "False")],
        "same-time-list": [(V, "revoke", "new.issued <=", "new.issued <")],
        "first-list-stays": [(V, "revoke", "and new.issued <= present.issued", "")],
        "source-not-checked": [(V, JUDGE, "message.src not in certificate.ids", "False")],
        "first-id-only": [(V, JUDGE, "message.src not in certificate.ids",
            "message.src != certificate.ids[0]")],
        "roles-not-checked": [(V, JUDGE, "not certificate.permits(message)", "False")],
        "role-by-type": [(certificates, "needed", "message.session[0] == message.src", "True")],
        "scenario-not-checked": [(*PERMITS, "and message.scenario in self.scenarios", "")],
        "scenario-for-all": [(*PERMITS, "return needed(message)",
            "return not self.scenarios and needed(message)")],
        "plain-message": [(V, "receive", "try:",
            'if data[:1] == b"{":\n        return [Verified(data, 9, None, datagram)]\n    try:')],
        "missing-bytes": [(V, READ, "envelope.read(data,", 'envelope.read(data + b"\\0",')],
        "trailing-bytes": [(cose, "short_list", "encode(items) != data",
            "not data.startswith(encode(items))")],
        "other-encodings": [*OTHER_ENCODINGS, (cose, "read", "short_list", "decode"),
            (envelope, "read", "cose.short_list", "cose.decode")],
        "tag-ignored": [(cose, "read", "short_list(data)",
            'short_list(data.removeprefix(b"\\xd2"))')],
        "unsigned-header": [*UNSIGNED_HEADER, (cose, "read", "short_list", "decode")],
        "high-s": [(cose, "verify", "s > ORDER // 2", "False")],
        "algorithm-not-compared": ANY_ALGORITHM,
        "header-not-compared": [(envelope, "read", "len(signed.header) != 1 or ", "")],
        "digest-of-any-length": [(envelope, "read", "or len(signer) != DIGEST_BYTES", "")],
        "request-of-any-length": [(envelope, "read", "len(wanted) != DIGEST_BYTES", "False")],
        "time-of-any-type": [(envelope, "read", "cose.short_list", "cose.decode")],
        "payload-of-any-length": [(envelope, "read", "bytes() as wanted]",
            "bytes() as wanted, *_]")],
        "malformed-message": [(V, "_decoded", "raise _Refused(Rejection.MALFORMED) from None",
            'return Cam.model_construct(type="CAM", src=9, generation_ms=read.generation_ms)')],
        "kinds-confused": [(*BOUNDS, "cose.unpacked(value, _CONTEXT)",
            "cose.unpacked(value, _REVOKED)")],
        "point-not-checked": [(V, ADMIT, "raise _Refused(Rejection.MALFORMED) from None", "raise")],
    },
}  # fmt: skip
"""By kernel and bug."""


def put(edits: list[Edit]) -> dict[tuple[Any, str], Any]:
    """The functions with these edits, in the namespace of their modules."""
    sources: dict[tuple[Any, str], str] = {}
    for where, name, old, new in edits:
        function = inspect.getattr_static(where, name)
        source = sources.get((where, name)) or textwrap.dedent(inspect.getsource(function))
        assert source.count(old) == 1, f"{name}: {source.count(old)} times {old!r}"
        sources[where, name] = source.replace(old, new)
    made: dict[tuple[Any, str], Any] = {}
    for (where, name), source in sources.items():
        functions: dict[str, Any] = {}
        module = inspect.getattr_static(where, name).__globals__
        exec(compile(source, f"<{name} with a bug>", "exec"), module, functions)
        made[where, name] = functions[name]
    return made
