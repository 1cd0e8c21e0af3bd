"""The bytes that a signature adds, for the bandwidth experiment, by an encoder of others.

    python reference/tests/foreign_signature.py

Needs pycrate, which has the ASN.1 of IEEE 1609.2; without it this is skipped, and says so.
"""

from __future__ import annotations

import importlib
import sys
from typing import Any

from automcm_evaluation.bandwidth.bandwidth_tables import CERTIFICATE, DIGEST

PAYLOAD = bytes(100)
SIGNATURE = ("ecdsaNistP256Signature", {"rSig": ("x-only", bytes(32)), "sSig": bytes(32)})
TICKET: dict[str, Any] = {  # an authorization ticket, TS 103 097
    "version": 3,
    "type": "explicit",
    "issuer": ("sha256AndDigest", bytes(8)),
    "toBeSigned": {
        "id": ("none", 0),
        "cracaId": bytes(3),
        "crlSeries": 0,
        "validityPeriod": {"start": 700_000_000, "duration": ("hours", 168)},
        "appPermissions": [
            {"psid": 36, "ssp": ("bitmapSsp", bytes(3))},  # CAMs
            {"psid": 37, "ssp": ("bitmapSsp", bytes(4))},  # as long for maneuvers: assumed
        ],
        "verifyKeyIndicator": (
            "verificationKey",
            ("ecdsaNistP256", ("compressed-y-0", bytes(32))),
        ),
    },
    "signature": SIGNATURE,
}


def signed(encoder: Any, signer: tuple[str, Any]) -> int:
    """The bytes of a signed PAYLOAD, without those of PAYLOAD."""
    inner = {"protocolVersion": 3, "content": ("unsecuredData", PAYLOAD)}
    body = {
        "hashId": "sha256",
        "tbsData": {
            "payload": {"data": inner},
            "headerInfo": {"psid": 36, "generationTime": 700_000_000_000_000},
        },
        "signer": signer,
        "signature": SIGNATURE,
    }
    encoder.set_val({"protocolVersion": 3, "content": ("signedData", body)})
    return len(encoder.to_coer()) - len(PAYLOAD)


def main() -> int:
    """0 if both have as many bytes as the experiment takes, or were skipped; 1 if not."""
    try:
        ieee = importlib.import_module("pycrate_asn1dir.ITS_IEEE1609_2")
    except ImportError:
        print("SKIPPED: the signature: pycrate is missing")
        return 0
    encoder = ieee.Ieee1609Dot2.Ieee1609Dot2Data
    found = signed(encoder, ("digest", bytes(8))), signed(encoder, ("certificate", [TICKET]))
    if found != (DIGEST, CERTIFICATE):
        print(f"FAILED: a signature adds {found} bytes, not {(DIGEST, CERTIFICATE)}")
        return 1
    print(f"a signature adds {DIGEST} bytes with a digest and {CERTIFICATE} with a certificate")
    return 0


if __name__ == "__main__":
    sys.exit(main())
