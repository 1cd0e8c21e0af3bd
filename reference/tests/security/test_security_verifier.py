"""Signed messages: what is accepted, and each reason for which a datagram is rejected.

``test_security_mutants.py`` runs every test of this file against mutants, so that each finishes
quickly and takes no fixture.
"""

from __future__ import annotations

from automcm_stage import ack, advertisement, cam, cancel, fin, intention, no, prescription, yes
from security_stage import (
    AUTHORITY,
    DAY,
    NOW,
    OTHER_AUTHORITY,
    credentials,
    key,
    knowing,
    new_verifier,
    seal,
    verdicts,
)

from automcm.security import certificates, cose, envelope, verifier
from automcm.security.certificates import Credentials
from automcm.security.verifier import Rejected, Verified
from automcm_spec.vocabulary.messages import MAX_BYTES, encode
from automcm_spec.vocabulary.parameters import ParameterError, Parameters

ONE, NINE = credentials(1), credentials(9)
WINDOW = 2100
"""By default t_life - (t_giveup - t_resend) - 100 ms."""


def test_a_message_with_its_certificate_is_accepted_then_with_its_digest() -> None:
    by = new_verifier()
    for now, whole in ((NOW, True), (NOW + 100, False)):
        (found,) = by.receive(seal(NINE, fin(), now, whole=whole), now, "9:1")
        assert isinstance(found, Verified)
        assert (found.message, found.src, found.wanted) == (encode(fin()), 9, None)
        assert found.datagram.tx == "9:1"


def test_no_changed_byte_is_accepted() -> None:
    """Whatever is changed, in a station that knows the certificate and in one that does not."""
    for whole in (True, False):
        data = seal(NINE, fin(), whole=whole, wanted=b"12345678")
        by = knowing(NINE, per_second=100_000)
        for at in range(len(data)):
            for bits in (0x01, 0x80, 0xFF):
                changed = data[:at] + bytes([data[at] ^ bits]) + data[at + 1 :]
                assert "accepted" not in verdicts(by, changed), at
                assert "accepted" not in verdicts(new_verifier(), changed), at
        late = verdicts(
            by, seal(NINE, cam(9, NOW + WINDOW + 1), NOW + WINDOW + 1), NOW + WINDOW + 1
        )
        assert late.count("accepted") == 1 and set(late) <= {"accepted", "unknown_signer"}


def test_no_part_and_no_extension_is_accepted() -> None:
    data = seal(NINE, fin())
    for end in range(len(data)):
        assert verdicts(new_verifier(), data[:end]) == ["malformed"]
    for more in (b"\0", b"\xf6", data):
        assert verdicts(new_verifier(), data + more) == ["malformed"]


def test_too_long() -> None:
    assert verdicts(new_verifier(), b"\x84" + bytes(MAX_BYTES)) == ["too_long"]
    assert verdicts(new_verifier(), b"\x84" + bytes(MAX_BYTES - 1)) == ["malformed"]


def test_what_is_not_an_envelope_is_malformed() -> None:
    tags = (
        b"\xd8\x1c\x81\xd8\x1d\x00",
        b"\xd8\x23\x61(",
        b"\xc0\x61x",
        b"\xc4\x82\x1b" + b"\x7f" * 9,
    )
    deep = b"\x81" * 60_000
    for data in (
        b"",
        encode(fin()),
        b"\xbf\xff",
        b"\x9b" + b"\x7f" * 8,
        b"\xa1\xa0\x02",
        deep,
        *tags,
    ):
        assert verdicts(new_verifier(), data) == ["malformed"]


def test_every_other_encoding_of_the_same_content_is_malformed() -> None:
    """The first byte says an array of four: also with one byte of length."""
    data = seal(NINE, fin())
    assert verdicts(new_verifier(), b"\x98\x04" + data[1:]) == ["malformed"]
    tagged = b"\xd2" + data  # COSE_Sign1 with its tag
    assert verdicts(new_verifier(), tagged) == ["malformed"]
    protected, _, payload, signature = cose.decode(data)
    unsigned = cose.encode([protected, {4: b"12345678"}, payload, signature])
    assert verdicts(new_verifier(), unsigned) == ["malformed"]


def test_crafted_keys_never_meet_in_a_map() -> None:
    """4,500 keys that Python's hash does not tell apart take 0.15 s if they are put into a map."""
    crafted = cose.encode({k * 8 * (2**61 - 1): 0 for k in range(1, 101)})
    for with_map, said in ((False, "map key must be"), (True, "more than 640")):
        try:
            cose.decode(crafted, with_map=with_map)
        except cose.Malformed as error:
            assert said in str(error)
        else:
            raise AssertionError


def envelope_of(header: dict[int, object], payload: object) -> bytes:
    return cose.sign(NINE.key, header, cose.encode(payload), envelope.CONTEXT + b"json")


def test_malformed_headers_and_payloads() -> None:
    by = knowing(NINE)
    own = {cose.KID: NINE.certificate.digest}
    whole = {cose.KCWT: NINE.certificate.encoded}
    payload = [NOW, encode(fin())]
    assert verdicts(by, envelope_of(own, payload)) == ["accepted"]
    for header in ({}, own | whole, own | {3: 50}, {cose.KID: b"1"}, {cose.KCWT: [1]}):
        assert verdicts(by, envelope_of(header, payload)) == ["malformed"]
    m = encode(cam(9, NOW))
    for other in ([], [NOW], [True, m], ["", m], [NOW, m, b"1"], [NOW, m, b"12345678", 0]):
        assert verdicts(by, envelope_of(own, other)) == ["malformed"]
    other_algorithm = {cose.ALGORITHM: -35} | own
    assert verdicts(by, envelope_of(other_algorithm, payload)) == ["malformed"]


def test_a_malformed_message_is_rejected_although_it_is_signed() -> None:
    data = envelope.seal(NINE, "json", b'{"type":"Fin"}', NOW, whole=True)
    assert verdicts(new_verifier(), data) == ["malformed"]


def test_a_message_of_another_codec_is_not_read() -> None:
    data = envelope.seal(NINE, "uper", encode(fin()), NOW, whole=True)
    assert verdicts(new_verifier(), data) == ["bad_signature"]


def test_stale_and_early_at_their_bounds() -> None:
    by = knowing(NINE)
    assert verdicts(by, seal(NINE, fin(), NOW), NOW + WINDOW) == ["accepted"]
    assert verdicts(by, seal(NINE, fin(), NOW), NOW + WINDOW + 1) == ["stale"]
    assert verdicts(by, seal(NINE, fin(), NOW + 100), NOW) == ["accepted"]
    assert verdicts(by, seal(NINE, fin(), NOW + 101), NOW) == ["early"]


def test_act_5_the_generation_time_of_a_cam_has_the_same_bounds() -> None:
    by = knowing(NINE)
    assert verdicts(by, seal(NINE, cam(9, 2**53 - 1))) == ["early"]
    assert verdicts(by, seal(NINE, cam(9, NOW - WINDOW - 1))) == ["stale"]


def test_the_window_follows_from_t_life_and_leaves_room_for_honest_copies() -> None:
    assert verifier.freshness_ms(Parameters()) == WINDOW
    assert verifier.freshness_ms(Parameters(t_timeout=100)) == 200
    try:
        verifier.freshness_ms(Parameters(t_timeout=0))
    except ParameterError as error:
        assert "t_timeout" in str(error)
    else:
        raise AssertionError


def test_a_copy_is_replayed_until_it_is_stale() -> None:
    for whole in (True, False):
        by, data = knowing(NINE), seal(NINE, fin(), whole=whole)
        got = [verdicts(by, data, NOW + later) for later in (0, 0, 1, WINDOW, WINDOW + 1)]
        assert got == [["accepted"], *[["replayed"]] * 3, ["stale"]]


def test_a_copy_is_replayed_although_others_came_meanwhile() -> None:
    by, data = knowing(NINE), seal(NINE, fin(), NOW + 100)
    assert verdicts(by, data) == ["accepted"]
    for later in range(50, WINDOW + 50, 50):
        sealed = seal(NINE, cam(9, NOW + later), NOW + later)
        assert verdicts(by, sealed, NOW + later) == ["accepted"]
        assert verdicts(by, data, NOW + later) == ["replayed"]


def test_the_same_content_signed_again_is_a_copy() -> None:
    """The memory does not depend on the signature, and a signature has one form only."""
    data = seal(NINE, fin(), whole=False)
    protected, empty, payload, signature = cose.decode(data)
    other = signature[:32] + (cose.ORDER - int.from_bytes(signature[32:])).to_bytes(32)
    turned = cose.encode([protected, empty, payload, other])
    assert verdicts(knowing(NINE), turned) == ["bad_signature"]
    by = knowing(NINE)
    assert [*verdicts(by, data), *verdicts(by, turned)] == ["accepted", "replayed"]
    assert verdicts(by, seal(NINE, fin(), whole=True)) == ["replayed"]


def test_what_is_rejected_for_its_signature_leaves_no_trace() -> None:
    by, data = knowing(NINE), seal(NINE, fin(), whole=False)
    forged = data[:-1] + bytes([data[-1] ^ 1])
    assert [*verdicts(by, forged), *verdicts(by, data)] == ["bad_signature", "accepted"]


def test_the_replay_memory_forgets_what_is_stale() -> None:
    by = knowing(NINE)
    for later in range(0, 60_000, 500):
        sealed = seal(NINE, cam(9, NOW + later), NOW + later)
        assert verdicts(by, sealed, NOW + later) == ["accepted"]
    assert sum(map(len, by._seen.values())) <= 3 * WINDOW // 500


def test_the_own_message_is_replayed() -> None:
    (found,) = new_verifier().receive(seal(NINE, fin()), NOW, None, NINE.certificate.digest)
    assert isinstance(found, Rejected) and found.reason == "replayed"


def test_an_unknown_signer_waits_for_its_certificate() -> None:
    by = new_verifier()
    first, second = seal(NINE, fin(), whole=False), seal(NINE, cam(9, NOW), NOW, whole=False)
    assert by.wanted is None
    assert verdicts(by, first) == verdicts(by, second) == []
    assert by.wanted == NINE.certificate.digest
    found = by.receive(seal(NINE, cam(9, NOW + 50), NOW + 50), NOW + 50)
    messages = [each.message for each in found if isinstance(each, Verified)]
    assert messages == [encode(each) for each in (fin(), cam(9, NOW), cam(9, NOW + 50))]
    assert by.wanted is None


def test_each_waits_for_its_own_certificate() -> None:
    by = new_verifier()
    assert verdicts(by, seal(ONE, cam(1, NOW), whole=False)) == []
    assert verdicts(by, seal(NINE, cam(9, NOW))) == ["accepted"]
    assert verdicts(by, seal(ONE, cam(1, NOW + 1), NOW + 1), NOW + 1) == ["accepted", "accepted"]


def test_of_two_copies_that_wait_one_is_accepted() -> None:
    by, data = new_verifier(), seal(NINE, fin(), whole=False)
    assert verdicts(by, data) == verdicts(by, data) == []
    assert verdicts(by, seal(NINE, cam(9, NOW))) == ["accepted", "replayed", "accepted"]


def test_what_has_waited_too_long_is_rejected() -> None:
    by = new_verifier()
    assert verdicts(by, seal(NINE, fin(), whole=False)) == []
    assert verdicts(by, b"", NOW + WINDOW) == ["malformed"]
    assert verdicts(by, b"", NOW + WINDOW + 1) == ["unknown_signer", "malformed"]
    assert by.wanted is None


def test_who_waits_is_bounded() -> None:
    by = new_verifier()
    for n in range(20):
        assert len(verdicts(by, seal(NINE, fin(), NOW - n, whole=False))) == (n >= 8)
    for n in range(100):
        verdicts(by, seal(credentials(100 + n), fin(), whole=False))
    assert len(by._waiting) == verifier.WAITING
    assert by._waiting[0][0].signer == credentials(100 + 68).certificate.digest


def test_a_certificate_of_an_unknown_authority() -> None:
    stranger = credentials(9, authority=OTHER_AUTHORITY)
    assert verdicts(new_verifier(), seal(stranger, fin())) == ["unknown_authority"]


def test_a_certificate_that_no_authority_has_signed() -> None:
    """The name of the authority is right, the signature is another's."""
    own = key(7)
    claims = cose.decode(ONE.certificate.signed.payload, with_map=True)
    claims[-65537] = [9]
    claims[8][1][-2] = own.public_key().public_numbers().x.to_bytes(32)
    claims[8][1][-3] = own.public_key().public_numbers().y % 2 == 1
    header = {cose.KID: ONE.certificate.authority}
    signed = cose.sign(own, header, cose.encode(claims), b"automcm.certificate/1")
    forged = Credentials(certificates.read(signed), own)
    by = new_verifier()
    assert verdicts(by, seal(forged, fin())) == ["bad_signature"]
    assert verdicts(by, seal(forged, fin(), whole=False)) == []


def test_a_list_of_revoked_certificates_is_no_certificate_and_the_other_way_round() -> None:
    by = new_verifier()
    assert not by.revoke(certificates.encoded(NINE.certificate))
    for other in (b"automcm.envelope/1 json", b"automcm.revocations/1", b""):
        header = {cose.KID: NINE.certificate.authority}
        payload = NINE.certificate.signed.payload
        value = cose.decode(cose.sign(AUTHORITY, header, payload, other), with_map=True)
        assert verdicts(by, envelope_of({cose.KCWT: value}, [NOW, encode(fin())])) == [
            "bad_signature"
        ]


def test_nothing_unsigned_in_a_certificate_changes_its_digest() -> None:
    """Otherwise its holder could escape revocation."""
    protected, _, payload, signature = NINE.certificate.encoded
    for value in ([protected, {4: b"x"}, payload, signature], [protected, {}, payload, signature]):
        data = envelope_of({cose.KCWT: value}, [NOW, encode(fin())])
        assert verdicts(new_verifier(), data) == ["malformed" if value[1] else "accepted"]


def test_a_certificate_counts_from_its_begin_to_its_end() -> None:
    end, begin = NOW // 1000 + DAY, NOW // 1000 - DAY
    for known in (True, False):
        for now, expected in (
            (end * 1000 - 1, "accepted"),
            (end * 1000, "certificate_expired"),
            (begin * 1000, "accepted"),
            (begin * 1000 - 1, "certificate_not_yet"),
        ):
            by = knowing(NINE) if known else new_verifier()
            assert verdicts(by, seal(NINE, fin(), now), now) == [expected]


def test_a_revoked_certificate_counts_no_more() -> None:
    issued = NOW // 1000
    listed = certificates.revoke(AUTHORITY, [NINE.certificate.digest], issued)
    empty = certificates.revoke(AUTHORITY, [], issued)
    foreign = certificates.revoke(OTHER_AUTHORITY, [NINE.certificate.digest], issued)
    forged = foreign.replace(
        certificates.authority_digest(OTHER_AUTHORITY.public_key()), NINE.certificate.authority
    )
    for by in (knowing(NINE), new_verifier()):
        assert not by.revoke(foreign) and not by.revoke(forged) and not by.revoke(b"")
        assert verdicts(by, seal(NINE, fin())) == ["accepted"]
        assert by.revoke(listed) and not by.revoke(empty)
        assert verdicts(by, seal(NINE, fin(), NOW + 1), NOW + 1) == ["revoked"]
        assert verdicts(by, seal(ONE, cam(1, NOW))) == ["accepted"]
        assert by.revoke(certificates.revoke(AUTHORITY, [], issued + 1))
        assert verdicts(by, seal(NINE, fin(), NOW + 2), NOW + 2) == ["accepted"]


def test_a_forged_message_under_the_digest_of_another() -> None:
    mine = Credentials(credentials(9, private=77).certificate, key(77))
    header, payload = {cose.KID: NINE.certificate.digest}, cose.encode([NOW, encode(fin())])
    forged = cose.sign(mine.key, header, payload, envelope.CONTEXT + b"json")
    assert verdicts(knowing(NINE), forged) == ["bad_signature"]


def test_the_source_is_one_of_the_ids_of_the_certificate() -> None:
    by = knowing(ONE, NINE)
    assert verdicts(by, seal(ONE, fin())) == ["wrong_source"]
    assert verdicts(by, seal(ONE, cam(9, NOW))) == ["wrong_source"]
    two = credentials(1, 9)
    assert verdicts(by, seal(two, fin())) == ["accepted"]
    (found,) = by.receive(seal(ONE, cancel()), NOW)
    assert isinstance(found, Rejected) and found.src == 9


def test_each_role_may_send_its_messages_only() -> None:
    as_prescriber = [
        advertisement(),
        advertisement(session=(1, 1), src=9),
        prescription(),
        fin(),
        cancel(),
        ack(intention(9, (9, 1), dst=9)).model_copy(update={"src": 9}),
    ]
    as_receiver = [
        intention(9),
        yes(src=9),
        no(src=9),
        cancel(src=9, session=(1, 1)),
        ack(prescription(session=(1, 1), dst=9)),
    ]
    sent = {"prescriber": as_prescriber, "receiver": as_receiver, "cam": [cam(9, NOW)]}
    for role in certificates.ROLES:
        own = credentials(9, roles=[role])
        for other, messages in sent.items():
            for message in messages:
                expected = "accepted" if role == other else "not_permitted"
                assert verdicts(new_verifier(), seal(own, message)) == [expected], (role, message)


def test_an_advertisement_needs_a_permitted_scenario() -> None:
    own = credentials(9, scenarios=["ramp_merge", "speed_advice"])
    for scenario, expected in (("ramp_merge", "accepted"), ("lane_change", "not_permitted")):
        sealed = seal(own, advertisement(scenario=scenario))
        assert verdicts(new_verifier(), sealed) == [expected]
    assert verdicts(new_verifier(), seal(own, prescription())) == ["accepted"]
    receiver = credentials(9, scenarios=["lane_change"], roles=["receiver"])
    assert verdicts(new_verifier(), seal(receiver, advertisement())) == ["not_permitted"]
