"""What must hold of a page in Firefox too: each function is a check, by its name."""

from __future__ import annotations

from pathlib import Path

from browser_firefox import Firefox
from browser_pages import PAGES, write_all
from browser_room_checks import WAYS, crossing

from automcm_traces.viewer.page import html

ARROW_DOWN = "\ue015"


def the_eight_pages_are_drawn_without_overlap(firefox: Firefox, folder: Path) -> None:
    wrong = []
    for name, path in write_all(folder).items():
        for width, height in ((1400, 800), (500, 844)):
            firefox.open(path, width, height)
            assert firefox.evaluate("document.querySelectorAll('#svg .marks .row').length") > 5
            for way, act in WAYS.items():
                firefox.evaluate(act)
                wrong += [(name, width, way, *pair) for pair in crossing(firefox.evaluate)]
    assert not wrong, (len(wrong), wrong[:8])


def keys_and_pointer_do_what_they_do_in_chromium(firefox: Firefox, folder: Path) -> None:
    (folder / "loss").mkdir()
    path = folder / "loss.html"
    path.write_bytes(html(PAGES["loss"](folder / "loss")))
    firefox.open(path)
    begun = firefox.evaluate("now.before[now.row]")
    firefox.press("jjk" + ARROW_DOWN)
    assert firefox.evaluate("now.before[now.row]") == begun + 2
    firefox.press(ARROW_DOWN, shift=True)
    assert firefox.evaluate("document.getElementById('span').hidden") is False
    assert " ms from step " in firefox.evaluate("document.getElementById('span-words').textContent")
    firefox.press("0")
    head, shown = firefox.evaluate("[[...copies.keys()].find(isShown), now.shown.length]")
    firefox.evaluate(f"select({head})")
    firefox.press("x")
    assert firefox.evaluate("now.shown.length") > shown
    firefox.press("x")
    assert firefox.evaluate("now.shown.length") == shown
    left, top = firefox.evaluate(
        "(() => { const r = svg.getBoundingClientRect(); return [r.left, r.top]; })()"
    )
    (a, begin), (b, end) = firefox.evaluate(
        "[150, 350].map(rowAt).map((row) => [row, down(row) - view.scrollTop + HEAD])"
    )
    firefox.drag((left + 60, top + begin), (left + 60, top + 250), (left + 60, top + end))
    assert (found := firefox.evaluate("now.span")) == [a, b], (found, a, b)
    firefox.press("0")
    firefox.evaluate("new Promise((done) => requestAnimationFrame(() => setTimeout(done, 100)))")
    edge = firefox.evaluate("layout.x[0] + layout.width[0]")
    firefox.drag((left + edge, top + 10), (left + edge + 20, top + 10))
    wider = firefox.evaluate("layout.x[0] + layout.width[0]")
    assert abs(wider - edge - 20) <= 1, (edge, wider)
    firefox.press("a?")
    assert firefox.evaluate(
        "[location.hash.endsWith('&time=logged'), document.getElementById('keys').open]"
    ) == [True, True]
