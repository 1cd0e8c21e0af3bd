"""The ETSI CAM that the bandwidth experiment takes as a yardstick, by an encoder of others.

    python reference/tests/foreign_cam.py

Needs pycrate, which has the ASN.1 of ETSI; without it this is skipped, and says so.
"""

from __future__ import annotations

import importlib
import sys
from typing import Any

from automcm_evaluation.bandwidth.bandwidth_tables import ETSI_CAM

UNKNOWN_ELLIPSE = {
    "semiMajorConfidence": 4095,
    "semiMinorConfidence": 4095,
    "semiMajorOrientation": 3601,
}
CAM: dict[str, Any] = {
    "header": {"protocolVersion": 2, "messageID": 2, "stationID": 3_000_000_001},
    "cam": {
        "generationDeltaTime": 12_345,
        "camParameters": {
            "basicContainer": {
                "stationType": 5,  # a passenger car
                "referencePosition": {
                    "latitude": 356_900_000,  # Nishi-Shinjuku
                    "longitude": 1_396_900_000,
                    "positionConfidenceEllipse": UNKNOWN_ELLIPSE,
                    "altitude": {"altitudeValue": 4000, "altitudeConfidence": "unavailable"},
                },
            },
            "highFrequencyContainer": (
                "basicVehicleContainerHighFrequency",
                {
                    "heading": {"headingValue": 900, "headingConfidence": 127},
                    "speed": {"speedValue": 833, "speedConfidence": 127},
                    "driveDirection": "forward",
                    "vehicleLength": {
                        "vehicleLengthValue": 45,
                        "vehicleLengthConfidenceIndication": "unavailable",
                    },
                    "vehicleWidth": 18,
                    "longitudinalAcceleration": {
                        "longitudinalAccelerationValue": 0,
                        "longitudinalAccelerationConfidence": 102,
                    },
                    "curvature": {"curvatureValue": 0, "curvatureConfidence": "unavailable"},
                    "curvatureCalculationMode": "yawRateUsed",
                    "yawRate": {"yawRateValue": 0, "yawRateConfidence": "unavailable"},
                },
            ),
        },
    },
}


def main() -> int:
    """0 if it has as many bytes as is said, or was skipped; 1 if not."""
    try:
        etsi = importlib.import_module("pycrate_asn1dir.ITS_CAM_2")
    except ImportError:
        print("SKIPPED: the ETSI CAM: pycrate is missing")
        return 0
    encoder = etsi.CAM_PDU_Descriptions.CAM
    encoder.set_val(CAM)
    data = encoder.to_uper()
    encoder.from_uper(data)
    if encoder.get_val() != CAM:
        print("FAILED: the ETSI CAM is not what was encoded")
        return 1
    if len(data) != ETSI_CAM:
        print(f"FAILED: an ETSI CAM has {len(data)} bytes, not {ETSI_CAM}")
        return 1
    print(f"an ETSI CAM has {len(data)} bytes, as said")
    return 0


if __name__ == "__main__":
    sys.exit(main())
