"""The vectors of certificate.json: what is read of a certificate, and what is malformed."""

from __future__ import annotations

from typing import Any

import secured_maker as maker
from cose_maker import Raw, cbor, digest, sign1

BUGS = {
    "digest-of-the-first-bytes": "The digest is the first 8 bytes of the hash, not the last.",
    "scenarios-ignored": "The list of scenarios is not read: all are permitted.",
    "fewer-ids": "A certificate with 16 ids is refused.",
    "any-number-of-ids": "More than 16 ids are taken.",
    "no-id": "A certificate without an id is taken.",
    "ids-in-any-order": "Ids may be in any order, or there twice.",
    "id-zero": "The id 0 is taken.",
    "id-of-33-bits": "An id above 2^32 - 1 is taken.",
    "empty-validity": "A certificate may end when it begins.",
    "endless-validity": "A time of 2^40 s or more is taken.",
    "roles-in-another-order": "The bits of the roles are read in another order.",
    "no-role": "A certificate without a role is taken.",
    "unknown-role": "A role that does not exist is taken.",
    "station-type-of-9-bits": "A station type above 255 is taken.",
    "missing-claim-assumed": "A claim that is missing gets a default.",
    "unknown-claim-ignored": "A claim that the profile does not have is ignored.",
    "scenarios-in-any-order": "Scenarios may be in any order.",
    "y-as-number": "The sign of y may be a number.",
    "any-curve": "The curve of the key is not compared.",
    "authority-of-any-length": "The digest of the authority may have any length.",
    "too-long": "A certificate of more than 512 bytes is taken.",
    "other-encodings": "An encoding that is not deterministic is taken.",
    "unsigned-header": "An entry of the unsigned header is ignored: the digest changes with it.",
    "algorithm-not-compared": "The algorithm of the header is not compared.",
    "any-point": "A key that is not a point of the curve is taken.",
    "short-signature": "A signature of less than 64 bytes is taken.",
}


def readable(
    id_: str, purpose: str, bug: str, signed: list[Any], content: maker.Json
) -> maker.Json:
    """A certificate that is read as ``content``, with its digest and that of the authority."""
    data = cbor(signed)
    more = {"authority": maker.named(maker.AUTHORITY).hex(), "digest": digest(data).hex()}
    expected = PLAIN | content | more
    return maker.vector("certificate", id_, purpose, bug, {"certificate": data.hex()}, expected)


def malformed(id_: str, purpose: str, bug: str, data: bytes | list[Any], why: str) -> maker.Json:
    """A certificate that is refused; ``why`` is not compared."""
    encoded = data if isinstance(data, bytes) else cbor(data)
    expected = {"error": {"name": "certificate", "why": why}}
    return maker.vector("certificate", id_, purpose, bug, {"certificate": encoded.hex()}, expected)


def of(**changes: Any) -> list[Any]:
    """A certificate of station 9, or with other ``ids`` or ``claims``."""
    more, ids = changes.pop("claims", {}), changes.pop("ids", [9])
    return maker.certify(maker.claims(maker.NINE.private, ids, **changes) | more)


def with_header(header: dict[int, Any]) -> list[Any]:
    """A certificate of station 9 with this header."""
    return sign1(
        maker.AUTHORITY, header, cbor(maker.claims(maker.NINE.private, [9])), maker.CONTEXT
    )


PLAIN = {
    "ids": [9],
    "not_before": maker.NOW_S - maker.DAY,
    "not_after": maker.NOW_S + maker.DAY,
    "roles": ["cam", "prescriber", "receiver"],
    "scenarios": None,
    "station_type": 5,
}
KEY = maker.claims(maker.NINE.private, [9])[maker.CNF][1]
WITHOUT_TYPE = {
    name: each for name, each in maker.claims(maker.NINE.private, [9]).items() if name != maker.TYPE
}
MANY = [f"scenario_{n:02}_{'x' * 20}" for n in range(12)]
WIDE_ID = Raw(b"\x81\x1a\x00\x00\x00\x09")  # [9] with four bytes for 9

VECTORS = [
    readable("plain", "A car for all scenarios.", "digest-of-the-first-bytes", of(), {}),
    readable("scenarios", "A road-side unit that may advertise two scenarios.",
        "scenarios-ignored", of(scenarios=["lane_change", "merge"], station_type=15),
        {"scenarios": ["lane_change", "merge"], "station_type": 15}),
    readable("sixteen-ids", "As many ids as there may be.", "fewer-ids",
        of(ids=[*range(1, 16), 2**32 - 1]), {"ids": [*range(1, 16), 2**32 - 1]}),
    readable("one-role", "A station that may only lead.", "roles-in-another-order",
        of(roles=maker.PRESCRIBER), {"roles": ["prescriber"]}),
    malformed("seventeen-ids", "One id too many.", "any-number-of-ids", of(ids=[*range(1, 18)]),
        "at most 16 ids"),
    malformed("no-id", "It has no id.", "no-id", of(ids=[]), "at least one id"),
    malformed("ids-do-not-ascend", "The ids do not ascend.", "ids-in-any-order",
        of(ids=[7, 9, 8]), "ids must ascend"),
    malformed("id-twice", "An id is there twice.", "ids-in-any-order", of(ids=[9, 9]),
        "ids must ascend"),
    malformed("id-zero", "The id 0 is no station.", "id-zero", of(ids=[0, 9]), "ids are above 0"),
    malformed("id-too-large", "An id needs 33 bits.", "id-of-33-bits", of(ids=[2**32]),
        "ids are below 2^32"),
    malformed("never-valid", "It ends when it begins.", "empty-validity",
        of(begin=maker.NOW_S, end=maker.NOW_S), "the end must be after the beginning"),
    malformed("ends-too-late", "It ends at 2^40 s.", "endless-validity", of(end=2**40),
        "the end must be below 2^40"),
    malformed("no-role", "It permits nothing.", "no-role", of(roles=0), "at least one role"),
    malformed("unknown-role", "It has a fourth role.", "unknown-role", of(roles=8 | maker.CAM),
        "there are three roles"),
    malformed("station-type-too-large", "A station type is a byte.", "station-type-of-9-bits",
        of(station_type=256), "a station type is at most 255"),
    malformed("claim-missing", "The station type is missing.", "missing-claim-assumed",
        maker.certify(WITHOUT_TYPE), "the claim -65539 is missing"),
    malformed("claim-unknown", "It has a claim more.", "unknown-claim-ignored",
        of(claims={-65541: 1}), "the claim -65541 is unknown"),
    malformed("scenarios-descend", "The scenarios descend.", "scenarios-in-any-order",
        of(scenarios=["merge", "lane_change"]), "scenarios must ascend"),
    malformed("y-as-number", "The sign of y is 1, not true.", "y-as-number",
        of(claims={maker.CNF: {1: KEY | {-3: 1}}}), "the sign of y must be a boolean"),
    malformed("other-curve", "The key names P-384.", "any-curve",
        of(claims={maker.CNF: {1: KEY | {-1: 2}}}), "the curve must be P-256"),
    malformed("not-on-the-curve", "No point of P-256 has the x of the key.", "any-point",
        of(claims=maker.OFF_CURVE), "not a point of P-256"),
    malformed("short-authority", "The digest of the authority has 7 bytes.",
        "authority-of-any-length", with_header({4: maker.named(maker.AUTHORITY)[1:]}),
        "a digest has 8 bytes"),
    malformed("too-long", "More than 512 bytes.", "too-long", of(scenarios=MANY), "too long"),
    malformed("wide-integer", "The id 9 is encoded in four bytes, and signed so.",
        "other-encodings", of(claims={maker.IDS: WIDE_ID}), "not a deterministic encoding"),
    malformed("wide-array",
        "The first byte has its length in a second one, which no signature covers.",
        "other-encodings", b"\x98\x04" + cbor(of())[1:], "not a deterministic encoding"),
    malformed("unsigned-header",
        "The unsigned header has an entry: the same certificate with another digest.",
        "unsigned-header", maker.swapped(of(), unprotected={4: b"x"}),
        "the unsigned header must be empty"),
    malformed("other-algorithm", "The header names ES384.", "algorithm-not-compared",
        with_header({1: -35, 4: maker.named(maker.AUTHORITY)}), "the algorithm must be ES256"),
    malformed("no-algorithm", "The header names no algorithm.", "algorithm-not-compared",
        with_header({1: None, 4: maker.named(maker.AUTHORITY)}), "the algorithm must be ES256"),
    malformed("short-signature", "The signature has 63 bytes.", "short-signature",
        maker.swapped(of(), signature=of()[3][:63]), "a signature has 64 bytes"),
]  # fmt: skip
