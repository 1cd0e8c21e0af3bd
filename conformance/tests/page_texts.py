"""The README and the pages of the site, committed and built."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from automcm_maintenance.documents import built_pages
from automcm_maintenance.documents.repository import ROOT

_BUILT = {ROOT / "docs" / name: make for name, make in built_pages.pages().items()}
PLACES = {ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *_BUILT}
PAGES = sorted(path for path in PLACES if path.parent.name != "traffic")  # it takes a second


@cache
def text(page: Path) -> str:
    """The text of a page, which is built when it is asked for."""
    return make() if (make := _BUILT.get(page)) else page.read_text(encoding="utf-8")
