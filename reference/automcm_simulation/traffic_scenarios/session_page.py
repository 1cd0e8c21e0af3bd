"""The page of one session of ``automcm simulate traffic``, with the traffic from above."""

from __future__ import annotations

from pathlib import Path

from automcm_simulation.traffic.traffic import Traffic
from automcm_spec.support import files
from automcm_traces.viewer.page import html
from automcm_traces.viewer.page_data import load
from automcm_traces.viewer.page_part import PagePart


def write(found: Traffic, out: Path) -> Path | None:
    """The page of the first session that was completed, or else agreed; None without one.

    ``out`` has the logs and the positions; a page of an earlier run is deleted.
    """
    (out / "page.html").unlink(missing_ok=True)
    stations = found.stations
    sessions = sorted(stations.completed & stations.agreed) or sorted(stations.agreed)
    if not sessions:
        return None
    session = min(sessions, key=lambda each: stations.began[each])
    partners = stations.partners[session]
    logs = [out / f"{number}.ndjson" for number in (session[0], *sorted(partners - {session[0]}))]
    page = load(
        logs, f"session {session[0]}/{session[1]} in traffic", part=PagePart(session=session)
    )
    page.traffic = out / "traffic.json"
    files.write(out / "page.html", html(page))
    return out / "page.html"
