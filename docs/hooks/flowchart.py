"""A flowchart in Mermaid, ``A --> B`` or ``A -->|label| B``, drawn as SVG.

The boxes stand in a column, each above all it points to.  An arrow to the next one is straight,
every other goes by a rail of its own on the right, those with a label last.
"""

from __future__ import annotations

import re
from graphlib import TopologicalSorter
from html import escape

from pymdownx.superfences import SuperFencesException  # type: ignore[import-untyped]

ARROW = re.compile(r"\s*(\w+) -->(?:\|([^|]+)\|)? (\w+)")
LEFT, BOX, HEIGHT, GAP = 8, 190, 46, 40
"""Where the boxes begin, their size and the space between two, px."""
RAIL = 22
"""From one rail to the next."""
PORT = 9
"""From one arrow to the next along the side of a box."""
WIDTH = 660
"""Of the whole: as wide as a state diagram, so that the letters are as large."""


def draw(source: str, defs: str) -> str:
    """The SVG; ``defs`` has the tip of an arrow.  Raises SuperFencesException for what is no
    arrow."""
    arrows = _read(source)
    sorter: TopologicalSorter[str] = TopologicalSorter()
    for begin, _, end in arrows:
        sorter.add(end, begin)
    rows = {name: row for row, name in enumerate(sorter.static_order())}
    tops = [8 + row * (HEIGHT + GAP) for row in range(len(rows))]
    parts = [
        f'<rect x="{LEFT}" y="{top}" width="{BOX}" height="{HEIGHT}" rx="6"/>'
        f'<text x="{LEFT + BOX // 2}" y="{top + HEIGHT // 2 + 5}" text-anchor="middle">'
        f"{escape(name)}</text>"
        for name, top in zip(rows, tops, strict=True)
    ]
    ports = [0] * len(rows)
    rail = LEFT + BOX
    ordered = sorted((bool(a[1]), rows[a[2]] - rows[a[0]], rows[a[0]], a) for a in arrows)
    for begin, label, end in (arrow for *_, arrow in ordered):
        a, b = rows[begin], rows[end]
        if b == a + 1:
            middle = LEFT + BOX // 2
            parts.append(_path(f"M{middle} {tops[a] + HEIGHT}V{tops[b]}"))
            if label:
                y = tops[b] - GAP // 2 + 4
                parts.append(f'<text x="{middle + 10}" y="{y}">{escape(label)}</text>')
            continue
        rail += RAIL
        ports[a] += 1
        ports[b] += 1
        out, into = tops[a] + HEIGHT - PORT * ports[a], tops[b] + PORT * ports[b]
        parts.append(_path(f"M{LEFT + BOX} {out}H{rail}V{into}H{LEFT + BOX}"))
        parts.append(f'<text x="{rail + 8}" y="{(out + into) // 2}">{escape(label)}</text>')
    return (
        '<svg role="img" aria-label="Flowchart" '
        f'viewBox="0 0 {WIDTH} {tops[-1] + HEIGHT + 8}">{defs}{"".join(parts)}</svg>'
    )


def _read(source: str) -> list[tuple[str, str, str]]:
    """Source, text and target."""
    arrows = []
    for line in source.strip().splitlines()[1:]:
        found = ARROW.fullmatch(line)
        if found is None:
            raise SuperFencesException(f"not an arrow of a flowchart: {line.strip()}")
        arrows.append((found[1], found[2] or "", found[3]))
    return arrows


def _path(way: str) -> str:
    return f'<path class="arrow" d="{way}" marker-end="url(#tip)"/>'
