"""What must hold of the room on a page, at each width: nothing overlaps, nothing is cut."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from browser_pages import write_all
from browser_stage import Browser, overlapping

WIDTHS = (1400, 1000, 390)
TEXTS = """() => {
  let node = 0;
  const found = [], walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const seen = (element, box) => {
    let {left, top, right, bottom} = box;
    for (let one = element; one instanceof Element; one = one.parentElement) {
      if (getComputedStyle(one).overflow === "visible" && one.id !== "svg") continue;
      const edge = one.getBoundingClientRect();
      [left, top] = [Math.max(left, edge.left), Math.max(top, edge.top)];
      [right, bottom] = [Math.min(right, edge.right), Math.min(bottom, edge.bottom)];
    }
    return right - left > 1 && bottom - top > 1 ? [left, top, right, bottom] : null;
  };
  while (walker.nextNode()) {
    const parent = walker.currentNode.parentElement;
    if (!walker.currentNode.data.trim() || !parent.checkVisibility()) continue;
    if (parent.closest("title, noscript, script, option, dialog:not([open])")) continue;
    node++;
    const range = document.createRange();
    range.selectNodeContents(walker.currentNode);
    for (const box of range.getClientRects()) {
      const part = seen(parent, box);
      if (part) found.push([...part, walker.currentNode.data, node]);
    }
  }
  return found;
}"""
ARROWS = """() => [...document.querySelectorAll("#svg .arrow > :not(.sign, title)")]
  .map((one) => one.getBoundingClientRect()).map((r) => [r.x, r.y, r.right, r.bottom, "arrow"])"""


def crossing(evaluate: Callable[[str], Any]) -> list[tuple[Any, Any]]:
    """Texts that overlap, and arrows that reach into the words of the events."""
    evaluate("draw()")
    texts, arrows = evaluate(f"({TEXTS})()"), evaluate(f"({ARROWS})()")
    assert len(texts) > 30
    pairs = [(a, b) for a, b in overlapping(texts) if a[-1] != b[-1]]
    words = evaluate(
        "layout.text.map((x) => x - (TWO ? view.scrollLeft : 0) + view.getBoundingClientRect().x)"
        ".map((x) => [x, x + layout.words])"
    )
    return pairs + [
        (arrow, span)
        for span in words
        for arrow in arrows
        if min(arrow[2], span[1]) - max(arrow[0], span[0]) > 1
    ]


def no_text_overlaps_another_or_an_arrow(browser: Browser, folder: Path) -> None:
    wrong = []
    for name, path in write_all(folder).items():
        for width in WIDTHS:
            size = {"width": width, "height": 844 if width < 800 else 800}
            with browser.page(path, viewport=size) as page:
                for way, act in WAYS.items():
                    page.evaluate(act)
                    wrong += [(name, width, way, *pair) for pair in crossing(page.evaluate)]
    assert not wrong, (len(wrong), wrong[:8])


WAYS = {
    "opened": "null",
    "middle": "view.scrollTop = view.scrollHeight / 2",
    "measured": "setMark(now.row), extend(5)",
    "real time": "toggleTime()",
    "logged": "toggleTime(), toggleLogged()",
}
"""What is looked at of a page, one after the other."""


def words_are_whole_below_eight_columns(browser: Browser, folder: Path) -> None:
    for name, path in write_all(folder).items():
        with browser.page(path, viewport={"width": 1400, "height": 800}) as page:
            columns = page.evaluate("layout.width.filter(Boolean).length")
            for part in range(10):
                page.evaluate(f"view.scrollTop = view.scrollHeight * {part} / 10; draw()")
                words = page.eval_on_selector_all(
                    "#svg text", "all => all.map((one) => one.textContent)"
                )
                # Two runs side by side have no room for the words of every timer.
                timers = (" arm ", " expire ") if name == "compare" else ()
                cut = [w for w in words if "…" in w and not any(one in w for one in timers)]
                assert not cut or columns > 8, (name, cut)
            right = page.evaluate("layout.total - view.clientWidth")
            assert right <= 0, (name, columns, "all columns are in the window")


def on_a_small_screen_controls_take_a_fifth_at_most(browser: Browser, folder: Path) -> None:
    for name, path in write_all(folder).items():
        size = {"width": 390, "height": 844}
        with browser.page(path, viewport=size, has_touch=True, is_mobile=True) as page:
            top = page.locator("#drawing").bounding_box()["y"]
            assert top <= size["height"] / 5, (name, top)
            assert page.evaluate("document.documentElement.scrollWidth") == size["width"], name
            page.click("#more")
            assert page.is_visible("#session") and page.is_visible("#as-table")
