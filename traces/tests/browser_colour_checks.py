"""What must hold of the colours on a page: each function is a check, by its name."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

from browser_stage import Browser
from page_rows import FOUR

Colour = tuple[float, ...]
SIGHTS: dict[str, tuple[Colour, ...]] = {
    "usual": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "deuteranopia": (
        (0.367322, 0.860646, -0.227968),
        (0.280085, 0.672501, 0.047413),
        (-0.011820, 0.042940, 0.968881),
    ),
    "protanopia": (
        (0.152286, 1.052583, -0.204868),
        (0.114503, 0.786281, 0.099216),
        (-0.003882, -0.048116, 1.051998),
    ),
}
"""What is seen of linear red, green and blue (Machado, Oliveira and Fernandes, 2009)."""
CONTRAST = 4.5
"""The least of text on its ground (WCAG 2, level AA)."""
APART = 10
"""The least distance of two colours in CIELAB; 2.3 is one that is just seen."""


def _linear(text: str) -> Colour:
    parts = (int(text[n : n + 2], 16) / 255 for n in (1, 3, 5))
    return tuple(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)


def _times(matrix: tuple[Colour, ...], colour: Colour) -> Colour:
    return tuple(sum(m * c for m, c in zip(row, colour, strict=True)) for row in matrix)


def _lab(colour: Colour) -> Colour:
    to_xyz = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
    white = (0.9505, 1, 1.089)
    parts = (max(0, c / w) for c, w in zip(_times(to_xyz, colour), white, strict=True))
    x, y, z = (c ** (1 / 3) if c > 0.008856 else 7.787 * c + 16 / 116 for c in parts)
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def _apart(a: str, b: str, sight: str) -> float:
    one, other = (_lab(_times(SIGHTS[sight], _linear(colour))) for colour in (a, b))
    return sum((x - y) ** 2 for x, y in zip(one, other, strict=True)) ** 0.5


def _luminance(text: str) -> float:
    return sum(w * c for w, c in zip((0.2126, 0.7152, 0.0722), _linear(text), strict=True))


def _colours(page: Any, names: list[str]) -> dict[str, str]:
    return {name: page.evaluate(f"colour('--{name}')") for name in names}


def colours_are_told_apart_and_read(browser: Browser, folder: Path) -> None:
    """The kinds of events and the phases, in both themes, also by the colour-blind."""
    path = browser.write("colours", *FOUR)
    for theme in ("light", "dark"):
        with browser.page(path, color_scheme=theme) as page:
            kinds = _colours(page, ["send", "receive", "dim", "told", "wrong"])
            others = _colours(page, ["text", "timer", "accent", "warn"])
            ground = _luminance(_colours(page, ["ground"])["ground"])
            for name, text in (kinds | others).items():
                low, high = sorted((ground, _luminance(text)))
                assert (high + 0.05) / (low + 0.05) >= CONTRAST, (theme, name)
            phases = _colours(page, page.evaluate("PHASE_NAMES"))
            for group in (kinds, phases):
                for a, b in combinations(group, 2):
                    for sight in SIGHTS:
                        far = _apart(group[a], group[b], sight)
                        assert far >= APART, (theme, sight, a, b, far)
