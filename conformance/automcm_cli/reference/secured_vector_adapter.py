"""The security of the reference behind the test vectors (docs/vectors.md).

Needs the extra ``automcm[secure]``; importing this without it raises MissingExtra.
"""

from __future__ import annotations

from typing import Any

from automcm.encoding.codec import JSON
from automcm.security import certificates, cose
from automcm.security.cose import Malformed
from automcm.security.verifier import Verified, Verifier
from automcm_spec.vocabulary.parameters import Parameters

Json = Any


def certificate(given: Json) -> Json:
    """The claims of a certificate; an error if it is malformed."""
    try:
        read = certificates.read(bytes.fromhex(given["certificate"]))
        read.key()
    except Malformed as error:
        return {"error": {"name": "certificate", "why": str(error)}}
    return {
        "ids": list(read.ids),
        "not_before": read.not_before,
        "not_after": read.not_after,
        "roles": sorted(read.roles),
        "scenarios": None if read.scenarios is None else sorted(read.scenarios),
        "station_type": read.station_type,
        "authority": read.authority.hex(),
        "digest": read.digest.hex(),
    }


def envelope(given: Json) -> Json:
    """The verdict on each datagram and on each list of revoked certificates."""
    authorities = [cose.public_key(bytes.fromhex(point)) for point in given["authorities"]]
    verifier = Verifier(authorities, JSON, Parameters())
    own = bytes.fromhex(given["own"] or "")
    verdicts: list[str] = []
    accepted: dict[int, Verified] = {}
    for n, event in enumerate(given["events"]):
        if "revocations" in event:
            taken = verifier.revoke(bytes.fromhex(event["revocations"]))
            verdicts.append("list_taken" if taken else "list_ignored")
            continue
        verdicts.append("waiting")
        data = bytes.fromhex(event["envelope"])
        for verdict in verifier.receive(data, event["now"], str(n), own):
            of = int(verdict.datagram.tx or "")
            if isinstance(verdict, Verified):
                verdicts[of], accepted[of] = "accepted", verdict
            else:
                verdicts[of] = str(verdict.reason)
    answers = [accepted.get(n) for n in range(len(verdicts))]
    return {
        "verdicts": verdicts,
        "messages": [each and each.message.decode() for each in answers],
        "wanted": [each and each.wanted and each.wanted.hex() for each in answers],
    }
