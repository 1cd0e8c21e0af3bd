"""Diagrams in Mermaid, drawn as SVG when the site is built: a page loads no script for them.

A flowchart is for ``flowchart.py``.  Of state diagrams only what
``automcm_maintenance/documents/state_diagrams.py`` writes is understood: ``A --> B :
event<br/>event``.  The states stand in a column.  Ways back to the first go by a rail on the left,
other ways that leave a state out by one on the right.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from html import escape
from typing import Any

import flowchart
from mkdocs.config.defaults import MkDocsConfig
from pymdownx.superfences import SuperFencesException  # type: ignore[import-untyped]

ARROW = re.compile(r"\s*(\w+) --> (\w+) : (.+)")
BOX, HEIGHT, LINE, GAP = 130, 32, 15, 26
"""A box, the distance of two lines of text, and the least distance of two boxes: px."""
LEFT, WIDTH = 252, 660
"""Where the boxes begin, and the whole."""
MIDDLE, RIGHT = LEFT + BOX // 2, LEFT + BOX
RAIL = 12
"""How far the rails are from the edge."""
EM_SPACE = "\N{EM SPACE}"
"""As wide as an arrow; SVG keeps it at the beginning of a line."""


@dataclass(frozen=True)
class Arrow:
    """From row to row, with its causes, one per line."""

    source: int
    target: int
    lines: list[str]

    @property
    def between(self) -> bool:
        """It joins two rows that follow each other, and does not lead back to the first."""
        return abs(self.source - self.target) == 1 and self.target != 0


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Blocks of Mermaid are for ``draw``."""
    fences = config.mdx_configs.setdefault("pymdownx.superfences", {})
    fences["custom_fences"] = [{"name": "mermaid", "class": "", "format": draw}]
    return config


def draw(source: str, *_: Any, **__: Any) -> str:
    """The diagram.  Raises SuperFencesException, which alone ends the build, for a line
    that is no arrow."""
    drawn = flowchart.draw(source, TIP) if source.startswith("flowchart") else _states(source)
    return f'<div class="diagram">{drawn}</div>'


TIP = (
    '<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" '
    'orient="auto-start-reverse"><path d="M0 0 8 4 0 8z"/></marker></defs>'
)


def _states(source: str) -> str:
    names, arrows = _read(source)
    into = [_above(row, arrows) for row in range(len(names))]
    tops = [8]
    for space in into[1:]:
        tops.append(tops[-1] + HEIGHT + space)
    middles = [top + HEIGHT // 2 for top in tops]
    parts = [_box(name, top) for name, top in zip(names, tops, strict=True)]
    for arrow in arrows:
        if arrow.target == arrow.source:
            parts += _loop(arrow, middles[arrow.source])
        elif not arrow.between:
            parts += _rail(arrow, middles)
    for row in range(1, len(names)):
        parts += _joints(row, tops, arrows)
    return (
        '<svg role="img" aria-label="State diagram" '
        f'viewBox="0 0 {WIDTH} {tops[-1] + HEIGHT + 8}">{TIP}{"".join(parts)}</svg>'
    )


def _read(source: str) -> tuple[list[str], list[Arrow]]:
    """The states, in the order in which they are named, and the arrows."""
    rows: dict[str, int] = {}
    arrows = []
    for line in source.strip().splitlines()[1:]:
        if line.strip().startswith("[*]"):
            continue
        found = ARROW.fullmatch(line)
        if found is None:
            raise SuperFencesException(f"not an arrow of a state diagram: {line.strip()}")
        ends = [rows.setdefault(name, len(rows)) for name in found.group(1, 2)]
        lines = [
            part + (" /" if n == 0 and "/" in label else "")
            for label in found[3].split("<br/>")
            for n, part in enumerate(label.split(" / "))
        ]
        arrows.append(Arrow(ends[0], ends[1], lines))
    return list(rows), arrows


def _above(row: int, arrows: list[Arrow]) -> int:
    """The space that a row needs above its box for its text."""
    beside = [len(a.lines) for a in arrows if a.source == row and not a.between] or [0]
    between = sum(len(a.lines) for a in arrows if a.between and max(a.source, a.target) == row)
    return max(GAP, LINE * max(beside) - HEIGHT // 2 + 16, LINE * between + 16)


def _box(name: str, top: int) -> str:
    return (
        f'<rect x="{LEFT}" y="{top}" width="{BOX}" height="{HEIGHT}" rx="6"/>'
        f'<text x="{MIDDLE}" y="{top + 21}" text-anchor="middle">{escape(name)}</text>'
    )


def _path(way: str) -> str:
    return f'<path class="arrow" d="{way}" marker-end="url(#tip)"/>'


def _text(x: int, y: int, lines: list[str], anchor: str) -> list[str]:
    """Lines of which the last stands at ``y``."""
    first = y - LINE * (len(lines) - 1)
    return [
        f'<text x="{x}" y="{first + LINE * n}" text-anchor="{anchor}">{escape(line)}</text>'
        for n, line in enumerate(lines)
    ]


def _rail(arrow: Arrow, middles: list[int]) -> list[str]:
    """Out to the side, along the rail and back; what brings it about stands on the way out."""
    begin, end = middles[arrow.source], middles[arrow.target]
    if arrow.target == 0:
        way = f"M{LEFT} {begin}H{RAIL}V{end}H{LEFT}"
        return [_path(way), *_text(LEFT - 8, begin - 6, arrow.lines, "end")]
    way = f"M{RIGHT} {begin}H{WIDTH - RAIL}V{end}H{RIGHT}"
    return [_path(way), *_text(RIGHT + 8, begin - 6, arrow.lines, "start")]


def _loop(arrow: Arrow, middle: int) -> list[str]:
    way = f"M{RIGHT} {middle + 9}h24v-18h-24"
    last = middle + 4 + LINE * (len(arrow.lines) - 1) // 2
    return [_path(way), *_text(RIGHT + 32, last, arrow.lines, "start")]


def _joints(row: int, tops: list[int], arrows: list[Arrow]) -> list[str]:
    """The arrows between a row and the one above, and to the right what brings them about."""
    above, below = tops[row - 1] + HEIGHT, tops[row]
    parts, lines = [], []
    for arrow in arrows:
        if not arrow.between or max(arrow.source, arrow.target) != row:
            continue
        if arrow.target == row:
            parts.append(_path(f"M{MIDDLE - 12} {above}V{below}"))
            sign = "\N{DOWNWARDS ARROW}"
        else:
            parts.append(_path(f"M{MIDDLE + 12} {below}V{above}"))
            sign = "\N{UPWARDS ARROW}"
        lines += [f"{sign if n == 0 else EM_SPACE} {line}" for n, line in enumerate(arrow.lines)]
    last = (above + below + LINE * len(lines)) // 2 - 4
    return [*parts, *_text(MIDDLE + 28, last, lines, "start")]
