"""Logs as one self-contained HTML file, which needs no network and no other file.

The page is ``viewer/page.html`` with its style and scripts inserted. All content of the logs is in
one JSON block, or escaped in the table shown without JavaScript.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from automcm_spec.log_format.event_text import safe, summary
from automcm_spec.support.templates import environment
from automcm_traces.edit.log_diff import text
from automcm_traces.viewer.page_data import Page, as_dict
from automcm_traces.viewer.page_pack import compact

Json = Any
VIEWER = Path(__file__).parent
SCRIPTS = [
    *("data.js", "layout.js", "ruler.js", "phases.js", "copies.js", "draw.js", "heads.js"),
    *("span.js", "map.js", "road.js", "panel.js", "save.js", "legend.js", "table.js", "keys.js"),
    *("address.js", "main.js"),
]
"""In the order of insertion."""
TABLE = 1_000
"""The maximum number of rows in the table shown without JavaScript, centred on the divergence."""


def html(page: Page) -> bytes:
    """The page. Equal logs give equal bytes."""
    data = as_dict(page)
    style = (VIEWER / "page.css").read_text(encoding="utf-8")
    script = "\n".join((VIEWER / name).read_text(encoding="utf-8") for name in SCRIPTS)
    templates = environment(VIEWER, autoescape=True)
    first, last = _part(page, data)
    differ = () if page.comparison is None else text(page.comparison.diff, width=120)
    page_text = templates.get_template("page.html").render(
        title=safe(page.title),
        style=style,
        script=script,
        policy=policy(script, style),
        data=compact(data),
        two=page.comparison is not None,
        verdicts=list(_verdicts(data)),
        difference=list(map(safe, differ)),
        rows=_table(page, first, last),
        shown=last - first,
        number=len(page.nodes),
    )
    return page_text.encode("utf-8", "backslashreplace")


def policy(script: str, style: str) -> str:
    """The Content Security Policy: only this script and this style, and no external resources."""
    return (
        f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _part(page: Page, data: dict[str, Json]) -> tuple[int, int]:
    """The range of rows in the table shown without JavaScript: around the first divergence or
    difference, or from the start."""
    marked = [log["diverges"] for log in data["logs"]]
    marked += [one["row"] for one in (data["compared"] or {"stations": []})["stations"]]
    at = min((row for row in marked if row >= 0), default=0)
    first = max(0, min(at - TABLE // 2, len(page.nodes) - TABLE))
    return first, min(len(page.nodes), first + TABLE)


def _verdicts(data: dict[str, Json]) -> Iterator[str]:
    """One line for each log."""
    if data["note"]:
        yield safe(data["note"])
    for name, run in zip("AB", data["runs"], strict=False):
        side = f"{name}: " if len(data["runs"]) > 1 else ""
        for verdict in run["verdicts"]:
            where = f"{verdict['file']}:{verdict['line']}" if verdict["line"] else verdict["file"]
            word = verdict["verdict"].replace("_", " ").upper()
            event = f": {verdict['event']}" if verdict["event"] else ""
            yield safe(f"{side}{where}: {word}{event}")


def _table(page: Page, first: int, last: int) -> Iterator[tuple[int, str, int, int, str]]:
    """Step, station, line, t_ms and summary of each row."""
    names = [page.name(i) for i in range(len(page.logs))]
    step = 0
    for row in range(last):
        step += row not in page.beside
        if row >= first:
            i, k = page.nodes[row]
            at, event = page.logs[i].events[k]
            yield step, names[i], at, event.t_ms, summary(event)
