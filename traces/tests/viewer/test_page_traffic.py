"""The positions of all road users on a page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from automcm_spec.support.bad_input import BadInput
from automcm_traces.viewer.page import html
from automcm_traces.viewer.page_data import as_dict, load

CORPUS = Path(__file__).parents[2] / "corpus"
LOGS = [CORPUS / "pair" / "1001.ndjson", CORPUS / "pair" / "2002.ndjson"]
USER = {"number": 1001, "equipped": True, "length_mm": 4500, "width_mm": 1800}


def written(folder: Path, count: int = 40, **wrong: Any) -> Path:
    frame = {"number": [1001], "x_mm": [0], "y_mm": [0], "heading_mrad": [0]}
    found: dict[str, Any] = {"every_ms": 200, "users": [USER]}
    found["frames"] = [frame | {"x_mm": [n]} for n in range(count)]
    path = folder / "traffic.json"
    path.write_text(json.dumps(found | wrong))
    return path


def test_a_page_has_the_frames_during_its_events(tmp_path: Path) -> None:
    page = load(LOGS)
    assert as_dict(page)["traffic"] is None
    page.traffic = written(tmp_path, count=2000)
    times = [page.logs[i].events[k][1].t_ms for i, k in page.nodes]
    found = as_dict(page)["traffic"]
    first, frames = found["first_ms"], found["frames"]
    assert first <= min(times) < first + 200
    assert frames[0]["x_mm"] == [first // 200]
    assert first + 200 * (len(frames) - 2) <= max(times) < first + 200 * len(frames)
    assert b'"every_ms":200' in html(page)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"every_ms": 0}, "every_ms"),
        ({"users": [USER | {"length_mm": -1}]}, "users.0.length_mm"),
        ({"frames": [{"number": [1], "x_mm": [], "y_mm": [0], "heading_mrad": [0]}]}, "frames.0"),
        ({"more": 1}, "more"),
    ],
)
def test_a_wrong_file_is_named_with_its_field(
    tmp_path: Path, wrong: dict[str, Any], named: str
) -> None:
    page = load(LOGS)
    page.traffic = written(tmp_path, **wrong)
    with pytest.raises(BadInput, match=rf"traffic\.json: {named}: "):
        html(page)
    page.traffic = tmp_path / "none.json"
    with pytest.raises(BadInput, match="cannot be read"):
        html(page)
