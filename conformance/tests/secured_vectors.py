"""Makes conformance/vectors/certificate.json and envelope.json (docs/vectors.md).

    python conformance/tests/secured_vectors.py

The expected verdict stands beside each vector; no verifier computes it.  The bugs are edits of the
reference (conformance/fault_catalogue/vectors.toml).
"""

from __future__ import annotations

import importlib

from automcm_conformance.adapter.kit_paths import VECTORS
from automcm_maintenance.exact_vectors import vector_texts

HEX, MS, S = "hexadecimal", "ms since 1970", "s since 1970"
TABLES = {
    "certificate": ("secured_certificates", {"certificate": HEX, "not_before": S, "not_after": S}),
    "envelope": (
        "secured_envelopes",
        dict.fromkeys(("authorities", "own", "envelope", "revocations", "wanted"), HEX)
        | {"now": MS},
    ),
}


def text(kernel: str) -> str:
    """The text of the file."""
    module, units = TABLES[kernel]
    table = importlib.import_module(module)  # signs all of them
    return vector_texts.text(
        {
            "schema": "automcm.vectors/1",
            "kernel": kernel,
            "rule": "secured",
            "units": units,
            "tolerance": {},
            "bugs": table.BUGS,
            "vectors": table.VECTORS,
        }
    )


if __name__ == "__main__":
    for name in TABLES:
        (VECTORS / f"{name}.json").write_text(text(name))
