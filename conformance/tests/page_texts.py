"""The README and the pages of the site, committed and built."""

from __future__ import annotations

from automcm_maintenance.documents import built_pages
from automcm_maintenance.documents.repository import ROOT

_BUILT = {ROOT / "docs" / name: make for name, make in built_pages.pages().items()}
PLACES = {ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *_BUILT}
TEXTS = {
    path: make() if (make := _BUILT.get(path)) else path.read_text(encoding="utf-8")
    for path in sorted(PLACES)
    if path.parent.name != "traffic"  # it takes a second
}
