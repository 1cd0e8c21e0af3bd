"""The vectors for signed messages: as made by code that shares none with the reference, which
verifies them with OpenSSL."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cose_maker
import pytest
from cli_stage import automcm
from cose_maker import cbor
from cryptography.hazmat.primitives.asymmetric import ec
from secured_maker import AUTHORITY, DAY, FIN, NINE, NOW, NOW_S, revocations, seal
from secured_vectors import TABLES, text

from automcm.security import certificates, envelope
from automcm.security.verifier import Rejection
from automcm_cli.reference import vector_adapter
from automcm_conformance.adapter.kit_paths import VECTORS
from automcm_conformance.vectors import vectors

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


def test_each_verdict_is_expected_somewhere_and_each_reason_is_a_verdict() -> None:
    expected = [case.expected for case in CASES.values() if case.kernel == "envelope"]
    schema = json.loads((VECTORS / vectors.SCHEMA).read_text())
    verdicts = {*schema["$defs"]["Envelope"]["properties"]["verdicts"]["items"]["enum"]}
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


def test_the_maker_signs_as_rfc_6979_says() -> None:
    """The example A.2.5 with SHA-256 and the message ``sample``."""
    private = 0xC9AFA9D845BA75166B5C215767B1D6934E50C3DB36E89B127B8A622B120F6721
    assert cose_maker.signature(private, b"sample") == (
        0xEFD48B2AACB6A8FD1140DD9CD45E81D69D2C877B56AAF991C34D0EA84EAF3716,
        0xF7CB1C942D657C41D436C7A1B6E29F65F3E900DBB9AFF4064DC4AB2F843ACDA8,
    )


# -- an implementation without signed messages


CALL = vector_adapter.call


def without(kernel: str, inputs: Any) -> Any:
    if kernel in vectors.SECURED:
        raise NotImplementedError("no keys here")
    return CALL(kernel, inputs)


def test_a_kernel_is_not_optional() -> None:
    def call(kernel: str, inputs: Any) -> Any:
        raise NotImplementedError

    [case, *_] = vectors.load(VECTORS / "success.json")
    [result] = vectors.check(call, [case])
    assert result.problem == "raised NotImplementedError: " and not result.ok


def test_the_command_says_what_is_not_supported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vector_adapter, "call", without)
    answer = automcm("vectors", "check")
    assert answer.exit_code == 0 and "envelope: not supported: no keys here\n" in answer.output
    answer = automcm("vectors", "check", "--json", "-")
    report = json.loads(answer.output)
    assert report["not_supported"] == dict.fromkeys(vectors.SECURED, "no keys here")
    assert not {row["kernel"] for row in report["vectors"]} & set(vectors.SECURED)
    answer = automcm("vectors", "check", "--kernel", "envelope")
    assert answer.exit_code == 3
    assert "vectors: envelope: not supported: no keys here\n" in answer.output


@pytest.mark.slow
def test_without_the_extra_the_reference_does_not_support_them() -> None:
    code = (
        "import sys; sys.modules['cbor2'] = None\n"
        "from automcm_cli.reference import vector_adapter\n"
        "vector_adapter.call('envelope', {})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    said = "NotImplementedError: a secured link needs cbor2: pip install 'automcm[secure]'"
    assert done.stderr.strip().endswith(said)
