"""A run as a picture: nothing that was sent or received is missing, and text stays text."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from merged_runs import later

from automcm_spec.log_format.reader import read
from automcm_traces.export.svg_drawing import drawing
from automcm_traces.system.log_merge import Merged, merge

FOUR = Path(__file__).parents[2] / "corpus" / "four-vehicles"
SVG = "{http://www.w3.org/2000/svg}"


def four(*stations: int) -> Merged:
    return merge([read(FOUR / f"{station}.ndjson") for station in stations])


def parts(text: str, name: str) -> list[ElementTree.Element]:
    return list(ElementTree.fromstring(text).iter(SVG + name))


def test_copies_are_one_arrow_with_their_number() -> None:
    merged = four(1001, 2002, 3003, 4004)
    arrows = [parts(drawing(merged, unfold=unfold), "g") for unfold in (False, True)]
    marks = [str(g[0].text).partition("\u00d7")[2] for g in arrows[0]]
    assert sum(int(mark or 1) for mark in marks) == len(arrows[1]) > len(arrows[0]) + 40
    assert all((len(g) > 2 and g[-1].text == f"\u00d7{m}") == bool(m)
               for g, m in zip(arrows[0], marks, strict=True))  # fmt: skip


def times(text: str) -> list[str | None]:
    return [t.text for t in parts(text, "text") if t.get("class") == "t"]


def test_times_count_from_the_first_event_whatever_the_clocks(tmp_path: Path) -> None:
    """Clocks that show the time since 1970, one of them 3 s ahead."""
    ahead = {"1001": 1_732_300_000_000, "2002": 1_732_300_003_000}
    late = merge([read(later(FOUR / f"{name}.ndjson", ms, tmp_path)) for name, ms in ahead.items()])
    first = merge([read(FOUR / f"{name}.ndjson") for name in ("1001", "2002")])
    shown = [float(str(time).split()[0]) for time in times(drawing(late, unfold=True))]
    wanted = [float(str(time).split()[0]) for time in times(drawing(first, unfold=True))]
    assert wanted[0] < 1 and len(shown) == len(wanted)
    assert all(abs(a - b) < 0.1 for a, b in zip(shown, wanted, strict=True))
    assert str(times(drawing(late, absolute=True))[0]).startswith("17323000")


def test_the_thick_lines_are_where_a_station_acts() -> None:
    text = drawing(four(1001, 2002, 3003, 4004))
    thick = [p.get("d", "") for p in parts(text, "path") if p.get("stroke-width") == "5"]
    assert sorted({d.split(" ")[0] for d in thick}) == ["M160", "M540"]


def test_a_station_without_a_log_has_a_line_and_what_it_gets_is_dashed() -> None:
    text = drawing(four(1001, 2002))
    assert [t.text for t in parts(text, "text")][:3] == ["1001", "2002", "3003"]
    assert any(p.get("stroke-dasharray") for p in parts(text, "path"))


def test_arrows_never_go_up_whatever_the_clocks_say(tmp_path: Path) -> None:
    ahead = {"1001": 50_000, "2002": 10_000}
    text = drawing(
        merge([read(later(FOUR / f"{name}.ndjson", ms, tmp_path)) for name, ms in ahead.items()])
    )
    paths = [g.find(f"{SVG}path") for g in parts(text, "g") if "delivered" in str(g[0].text)]
    ends = [re.match(r"M\S+ (\S+)L\S+ (\S+?)m", str(p.get("d"))) for p in paths if p is not None]
    ways = [(float(end[1]), float(end[2])) for end in ends if end]
    assert ways and all(begin < end for begin, end in ways)


def test_names_stay_text() -> None:
    text = drawing(four(1001), {1001: "<script>&\u202e"})
    assert "<script>" not in text and "\u202e" not in text
    assert parts(text, "text")[0].text == "<script>&\\u202e"


def test_a_long_wait_is_a_break_and_the_legend_says_what_is_drawn() -> None:
    text = drawing(four(1001, 2002, 3003, 4004))
    words = [str(t.text) for t in parts(text, "text")]
    waits = [word for word in words if word.startswith("+")]
    assert waits and all(float(word[1:-2]) > 1 for word in waits)
    assert words[-4:] == ["received", "lost", "acts as agreed", "\u00d72: two copies"]
