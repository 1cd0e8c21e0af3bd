"""The vectors for signed messages: as made, checked with openssl."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import cbor2
import cose_maker
import pytest
from cose_maker import cbor, compressed
from cryptography.hazmat.primitives.asymmetric import ec
from secured_maker import (
    AUTHORITY,
    DAY,
    FIN,
    NINE,
    NOW,
    NOW_S,
    OTHER_AUTHORITY,
    revocations,
    seal,
)
from secured_vectors import TABLES, text
from typer.testing import CliRunner

from automcm.security import certificates, envelope
from automcm.security.verifier import Rejection
from automcm_cli.reference import vector_adapter
from automcm_cli.reference import vector_commands as command
from automcm_conformance.adapter.kit_paths import VECTORS
from automcm_conformance.vectors import vectors
from automcm_conformance.vectors.vector_validation import Verdict

FILES = {name: json.loads((VECTORS / f"{name}.json").read_text()) for name in vectors.SECURED}
CASES = {case.id: case for name in FILES for case in vectors.load(VECTORS / f"{name}.json")}


@pytest.mark.parametrize("name", vectors.SECURED)
def test_the_file_is_what_its_maker_writes(name: str) -> None:
    made = text(name)
    assert (VECTORS / f"{name}.json").read_text() == made, "run secured_vectors.py"
    assert set(TABLES) == set(vectors.SECURED)


def test_the_maker_shares_no_code_with_the_reference() -> None:
    for name in ("cose_maker", "secured_maker", "secured_certificates", "secured_envelopes"):
        source = Path(__file__).parents[1].joinpath(f"{name}.py").read_text()
        imports = [line for line in source.splitlines() if line.startswith(("import ", "from "))]
        assert imports and not any("automcm" in line or "cbor2" in line for line in imports)


def test_there_are_enough() -> None:
    assert len(FILES["envelope"]["vectors"]) >= 25


def test_each_verdict_is_expected_somewhere_and_each_reason_is_a_verdict() -> None:
    expected = [case.expected for case in CASES.values() if case.kernel == "envelope"]
    verdicts = set(get_args(Verdict))
    assert {verdict for each in expected for verdict in each["verdicts"]} == verdicts
    others = {"accepted", "waiting", "list_taken", "list_ignored"}
    assert verdicts - others == {*Rejection} - {Rejection.TOO_LONG, Rejection.OVER_BUDGET}


def test_the_reference_writes_the_same_bytes() -> None:
    """Its signatures are deterministic too."""
    key = ec.derive_private_key(NINE.private, ec.SECP256R1())
    authority = ec.derive_private_key(AUTHORITY, ec.SECP256R1())
    valid = {"not_before": NOW_S - DAY, "not_after": NOW_S + DAY}
    issued = certificates.issue(authority, key.public_key(), ids=[9], **valid)
    assert certificates.encoded(issued) == cbor(NINE.certificate)
    own = certificates.Credentials(issued, key)
    for whole in (True, False):
        sealed = envelope.seal(own, "json", FIN, NOW, whole=whole, wanted=bytes(8))
        assert sealed == cbor(seal(NINE, FIN, whole=whole, wanted=bytes(8)))
    (given, *_) = revocations([NINE], 0, True)
    assert certificates.revoke(authority, [NINE.digest], NOW_S).hex() == given["revocations"]


# -- signatures, by openssl


def test_the_maker_signs_as_rfc_6979_says() -> None:
    """The example A.2.5 with SHA-256 and the message ``sample``."""
    private = 0xC9AFA9D845BA75166B5C215767B1D6934E50C3DB36E89B127B8A622B120F6721
    assert cose_maker.signature(private, b"sample") == (
        0xEFD48B2AACB6A8FD1140DD9CD45E81D69D2C877B56AAF991C34D0EA84EAF3716,
        0xF7CB1C942D657C41D436C7A1B6E29F65F3E900DBB9AFF4064DC4AB2F843ACDA8,
    )


Signed = tuple[bytes, bytes, bytes]
"""A compressed public key, the signed bytes, and r and s."""
ENVELOPE, CERTIFICATE = b"automcm.envelope/1 json", b"automcm.certificate/1"
KEYS = {
    cose_maker.digest(cbor(cose_maker.cose_key(each))): compressed(each)
    for each in (AUTHORITY, OTHER_AUTHORITY)
}


def signed(events: list[Any]) -> Iterator[list[Signed]]:
    """The signatures of each list and of each datagram with its certificate, if it is COSE."""
    known: dict[bytes, list[Any]] = {}
    for event in events:
        if "revocations" in event:
            yield [by_authority(event["revocations"], b"automcm.revocations/1")]
            continue
        try:
            parts = cbor2.loads(bytes.fromhex(event["envelope"]))
            header = cbor2.loads(parts[0])
            certificate = header.get(13) or known[header[4]]
            known[cose_maker.digest(cbor2.dumps(certificate, canonical=True))] = certificate
            claims = cbor2.loads(certificate[2])
            authority = KEYS[cbor2.loads(certificate[0])[4]]
        except (cbor2.CBORDecodeError, AttributeError, IndexError, KeyError, TypeError):
            yield []
            continue
        key = claims[8][1]
        point = bytes([2 + key[-3]]) + key[-2]
        yield [_signed(authority, certificate, CERTIFICATE), _signed(point, parts, ENVELOPE)]


def by_authority(data: str, context: bytes) -> Signed:
    """The signature of a certificate or list."""
    parts = cbor2.loads(bytes.fromhex(data))
    return _signed(KEYS[cbor2.loads(parts[0])[4]], parts, context)


def _signed(key: bytes, parts: list[Any], context: bytes) -> Signed:
    return key, cbor2.dumps(["Signature1", parts[0], context, parts[2]]), parts[3]


OPENSSL = ("openssl", "dgst", "-sha256", "-keyform", "DER")


@pytest.fixture(scope="module")
def openssl(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("openssl")
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed: the signatures have no third implementation")
    judged: dict[Signed, bool] = {}

    def judge(one: Signed) -> bool:
        if one not in judged:
            key, content, signature = one
            der = bytes.fromhex("3039301306072a8648ce3d020106082a8648ce3d030107032200") + key
            (folder / "key").write_bytes(der)
            (folder / "content").write_bytes(content)
            (folder / "signature").write_bytes(_der(signature))
            done = subprocess.run(
                [*OPENSSL, "-verify", "key", "-signature", "signature", "content"],
                cwd=folder,
                capture_output=True,
                text=True,
                check=False,
            )
            judged[one] = done.stdout == "Verified OK\n"
        return judged[one]

    return judge


def _der(signature: bytes) -> bytes:
    """r and s as ASN.1 (RFC 3279, 2.2.3)."""
    numbers = b""
    for part in (signature[:32], signature[32:]):
        number = int.from_bytes(part)
        size = number.bit_length() // 8 + 1
        numbers += bytes([2, size]) + number.to_bytes(size)
    return bytes([0x30, len(numbers)]) + numbers


WRONG = ("bad_signature", "list_ignored")
OTHERWISE = {
    "envelope-high-s": True,  # openssl takes both forms of a signature
    "envelope-not-on-the-curve": False,  # and no such key
    "envelope-list-of-another": True,
    "envelope-older-list": True,
    "envelope-same-time-list": True,
}


def test_openssl_agrees_on_each_signature(openssl: Any) -> None:
    """Only what is discarded for its signature has a wrong one; the rest has one fault less."""
    found = 0
    for case in (case for case in CASES.values() if case.kernel == "envelope"):
        verdicts = case.expected["verdicts"]
        for verdict, signatures in zip(verdicts, signed(case.inputs["events"]), strict=True):
            if not signatures:
                assert verdict == "malformed" or case.id.startswith("envelope-waits")
                continue
            expected = verdict not in WRONG
            if verdict in (*WRONG, "malformed"):
                expected = OTHERWISE.get(case.id, expected)
            assert all(map(openssl, signatures)) == expected, case.id
            found += 1
    assert found > 100


def test_openssl_agrees_on_each_certificate_that_is_read(openssl: Any) -> None:
    for case in CASES.values():
        if case.kernel == "certificate" and "error" not in case.expected:
            assert openssl(by_authority(case.inputs["certificate"], CERTIFICATE)), case.id


# -- an implementation without signed messages


CALL = vector_adapter.call


def without(kernel: str, inputs: Any) -> Any:
    if kernel in vectors.SECURED:
        raise NotImplementedError("no keys here")
    return CALL(kernel, inputs)


def test_signed_messages_are_optional() -> None:
    results = vectors.check(without, CASES.values())
    assert all(each.ok and each.not_supported == "no keys here" for each in results)


def test_a_kernel_is_not_optional() -> None:
    def call(kernel: str, inputs: Any) -> Any:
        raise NotImplementedError

    [case, *_] = vectors.load(VECTORS / "success.json")
    [result] = vectors.check(call, [case])
    assert result.problem == "raised NotImplementedError: " and not result.ok


def test_the_command_says_what_is_not_supported(monkeypatch: pytest.MonkeyPatch) -> None:
    run = CliRunner()
    monkeypatch.setattr(vector_adapter, "call", without)
    answer = run.invoke(command.app, ["check"])
    assert answer.exit_code == 0 and "envelope: not supported: no keys here\n" in answer.output
    answer = run.invoke(command.app, ["check", "--json", "-"])
    report = json.loads(answer.output)
    assert report["not_supported"] == dict.fromkeys(vectors.SECURED, "no keys here")
    assert not {row["kernel"] for row in report["vectors"]} & set(vectors.SECURED)
    answer = run.invoke(command.app, ["check", "--kernel", "envelope"])
    assert answer.exit_code == 3
    assert "vectors: envelope: not supported: no keys here\n" in answer.output


def test_without_the_extra_the_reference_does_not_support_them() -> None:
    code = (
        "import sys; sys.modules['cbor2'] = None\n"
        "from automcm_cli.reference import vector_adapter\n"
        "vector_adapter.call('envelope', {})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    said = "NotImplementedError: a secured link needs cbor2: pip install 'automcm[secure]'"
    assert done.stderr.strip().endswith(said)
