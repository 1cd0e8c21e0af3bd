"""The page of the faults of a station, from the results of ``make test-faults``."""

from __future__ import annotations

from typing import Any

from automcm_maintenance.documents.repository import ROOT, markdown_table

RESULTS = ROOT / "conformance" / "faults.json"
HEAD = """# Faults of a station

`make test-faults` starts a station and a peer on UDP. When the station enters a phase, the test
injects a fault, such as a failing system call, and observes the peer. Every fault has an expected
outcome. The test also checks that:

- the peer does not act longer than D + `t_cam_loss` after the station left or last sent a CAM that
  names the session (T-2);
- no CAM names a session that the station has left (ACT-5);
- the station stops on request, and its log can be read.

The first table shows how the session ended for the peer, by the phase in which the fault began. It
omits faults after which every session ended with a Fin.

- *Fin*: as if nothing had failed;
- *Cancel(reason)*: by a Cancel of the station;
- *end of CAMs*: no CAM that names the session came for `t_cam_loss` (ACT-2);
- *timer (rule)*: by another timer of the peer, before it acted;
- *no session*: the station never answered or never asked.

*Time jumps* and *the host sleeps* last 10 s. A log diverges where the fault delayed
a timer or lost a step.
"""


def markdown(found: dict[str, Any]) -> str:
    """The page."""
    faults = found["faults"].items()
    wide = [[name, *f["outcomes"]] for name, f in faults if set(f["outcomes"]) != {"Fin"}]
    narrow = [[name, f["codes"], f["log"], f["effect"]] for name, f in faults]
    heads = ["fault", *found["phases"]]
    ends = ["fault", "exit code", "log", "effect"]
    lines = [HEAD, markdown_table(heads, _alike(wide), heads), "", "## Why", ""]
    lines += [markdown_table(ends, _alike(narrow), ends), ""]
    lines.append(
        f"{found['cells']} cells, {found['repeated']} of them repeated; "
        f"unexpected: {len(found['problems'])}."
    )
    return "\n".join([*lines, *found["problems"], ""])


def _alike(rows: list[list[str]]) -> list[list[str]]:
    """Rows that differ only in their fault as one row."""
    faults: dict[tuple[str, ...], list[str]] = {}
    for fault, *rest in rows:
        faults.setdefault(tuple(rest), []).append(fault)
    return [["; ".join(names), *rest] for rest, names in faults.items()]
