"""Floods, bounds, certificates and the signer of signed messages.

As in ``test_security_verifier.py``, each test finishes quickly and takes no fixture.
"""

from __future__ import annotations

from unittest.mock import patch

from automcm_stage import cam, fin
from security_stage import AUTHORITY, NOW, credentials, key, knowing, seal, verdicts

from automcm.encoding.codec import JSON
from automcm.security import certificates, cose, envelope, verifier
from automcm.security.budget import Budget
from automcm.security.certificates import Credentials
from automcm.security.signer import PseudonymError, Signer
from automcm_spec.vocabulary.messages import encode

ONE, NINE, SEVEN = credentials(1), credentials(9), credentials(9, private=7)


def test_the_budget_leaves_something_to_the_peer_and_to_who_is_near() -> None:
    budget = Budget(100)
    spent = {rank: sum(budget.spend(rank, NOW) for _ in range(200)) for rank in (2, 1, 0)}
    assert spent == {2: 51, 1: 25, 0: 24}
    assert not budget.spend(0, NOW + 9) and budget.spend(0, NOW + 10)
    assert not budget.spend(1, NOW + 20) and not budget.spend(2, NOW + 20)
    assert sum(budget.spend(0, NOW + 60_000) for _ in range(200)) == 100


def test_a_flood_of_others_leaves_the_peer_its_verifications() -> None:
    """Twice the budget, for ten seconds: the peer at 10 Hz loses nothing."""
    by = knowing(ONE, NINE, per_second=50)
    by.ranking = lambda ids: 0 if ids == (9,) else 2
    lost = dict.fromkeys(("over_budget", "accepted"), 0)
    for later in range(0, 10_000, 10):
        now = NOW + later
        lost[verdicts(by, seal(ONE, cam(1, now), now, whole=False), now)[0]] += 1
        if later % 100 == 0:
            sealed = seal(NINE, cam(9, now), now, whole=False)
            assert verdicts(by, sealed, now) == ["accepted"]
    assert lost["over_budget"] > 400 and lost["accepted"] > 300


def test_copies_and_old_messages_cost_no_verification() -> None:
    by = knowing(ONE, NINE, per_second=20)
    copy, old = seal(ONE, cam(1, NOW)), seal(ONE, cam(1, NOW - 5000), NOW - 5000)
    assert verdicts(by, copy) == ["accepted"]
    for _ in range(100):
        assert [*verdicts(by, copy), *verdicts(by, old)] == ["replayed", "stale"]
    by.ranking = lambda ids: 0
    assert verdicts(by, seal(NINE, fin())) == ["accepted"]


def rubbish(number: int) -> bytes:
    """A certificate that claims to be of station 9 and our authority, with a wrong signature."""
    value = SEVEN.certificate.encoded
    changed = [*value[:3], value[3][:-2] + number.to_bytes(2)]
    own = Credentials(certificates.unpacked(changed), key(7))
    return seal(own, cam(9, NOW))


def test_end_5_before_its_signature_little_of_a_datagram_is_decoded() -> None:
    header = cose.encode({cose.ALGORITHM: cose.ES256, cose.KID: bytes(8)})
    for value in (1, b"", "", {}, []):
        items = cose.encode([value] * 60_000)
        for data in (items, cose.encode([header, {}, items, bytes(64)])):
            with patch.object(cose.cbor2, "loads", wraps=cose.cbor2.loads) as loads:
                assert verdicts(knowing(), data) == ["malformed"]
            assert all(len(call.args[0]) <= cose.MAP_BYTES for call in loads.call_args_list)


def test_hundreds_of_certificates_of_rubbish_are_not_kept() -> None:
    by = knowing(NINE)
    by.ranking = lambda ids: 0 if ids == (9,) else 2
    found = [verdicts(by, rubbish(n))[0] for n in range(1000, 1700)]
    assert set(found) == {"bad_signature", "over_budget"}
    assert found.count("bad_signature") <= 501
    assert list(by._known) == [NINE.certificate.digest]
    assert verdicts(by, seal(NINE, fin(), whole=False)) == ["accepted"]


def test_of_hundreds_of_good_certificates_those_used_last_are_kept() -> None:
    by = knowing(NINE, per_second=100_000)
    for n in range(1000, 1300):
        assert verdicts(by, seal(credentials(n, private=7), cam(n, NOW))) == ["accepted"]
        assert verdicts(by, seal(NINE, cam(9, NOW), NOW - n % 1000, whole=False)) == ["accepted"]
    assert len(by._known) == verifier.CERTIFICATES and NINE.certificate.digest in by._known


def test_a_certificate_is_bounded() -> None:
    begins = {"not_before": 0, "not_after": 1}
    for claims in (
        {"ids": []},
        {"ids": [0]},
        {"ids": [2**32]},
        {"ids": [1, 1]},
        {"ids": range(1, 18)},
        {"not_before": 1},
        {"not_before": -1},
        {"not_after": 2**40},
        {"roles": []},
        {"station_type": 256},
        {"station_type": True},
        {"scenarios": ["x" * 400]},
        {"scenarios": [1]},
    ):
        try:
            certificates.issue(AUTHORITY, key(3).public_key(), **{"ids": [1], **begins, **claims})
        except ValueError:
            continue
        raise AssertionError(claims)


def test_what_is_issued_is_read_again() -> None:
    own = credentials(3, 1, 2, roles=["cam"], scenarios=["b", "a"], station_type=15).certificate
    assert certificates.read(certificates.encoded(own)) == own
    assert (own.ids, own.roles, own.station_type) == ((1, 2, 3), {"cam"}, 15)
    assert own.scenarios == {"a", "b"} and len(own.digest) == 8


def test_credentials_belong_together_and_show_no_key() -> None:
    try:
        Credentials(NINE.certificate, ONE.key)
    except ValueError as error:
        assert "private key" in str(error)
    else:
        raise AssertionError
    secret = NINE.key.private_numbers().private_value
    assert str(secret) not in repr(NINE) and hex(secret)[2:] not in repr(NINE).lower()


def whole(data: bytes) -> bool:
    return envelope.read(data, "json").certificate is not None


def test_the_whole_certificate_once_a_second_and_on_request() -> None:
    signer = Signer(NINE, "json")
    sent = [whole(signer.sign(encode(fin()), NOW + later)) for later in range(0, 2100, 100)]
    assert [n for n, each in enumerate(sent) if each] == [0, 10, 20]
    signer.requested(ONE.certificate.digest)
    assert not whole(signer.sign(encode(fin()), NOW + 2100))
    signer.requested(NINE.certificate.digest)
    assert whole(signer.sign(encode(fin()), NOW + 2200))
    assert not whole(signer.sign(encode(fin()), NOW + 2300))


def test_an_id_changes_between_sessions_only() -> None:
    """A session's id contains that of its prescriber (ADV-1); a peer believes one id (OfPeer)."""
    signer, pseudonym, renewed = Signer(NINE, "json"), credentials(10), credentials(9, private=88)
    try:
        signer.change(pseudonym, in_use=9)
    except PseudonymError:
        pass
    else:
        raise AssertionError
    assert signer.credentials is NINE
    signer.change(renewed, in_use=9)
    assert whole(signer.sign(encode(fin()), NOW))
    signer.change(pseudonym, in_use=None)
    assert signer.credentials is pseudonym


def test_the_same_content_has_the_same_bytes() -> None:
    assert seal(NINE, fin()) == seal(NINE, fin())
    assert JSON.decode(envelope.read(seal(NINE, fin()), "json").message) == fin()
