"""What leads back to a view of a page, or takes it elsewhere: links, copies, pictures, time."""

from __future__ import annotations

import json
import struct
from itertools import pairwise
from pathlib import Path
from typing import Any

from browser_pages import four
from browser_stage import Browser, boxes
from merged_runs import simulated
from page_rows import FOUR

VIEW = """() => ({ row: now.row, shown: now.shown, time: now.time, scale: now.scale, span: now.span,
  unfolded: [...now.unfolded], follow: now.follow, logged: now.logged,
  table: !document.getElementById("tables").hidden, dark: isDark(),
  filters: Object.keys(filters).map((id) => chosenIn(filters[id])) })"""


def the_link_leads_back_to_the_view(browser: Browser, folder: Path) -> None:
    """Step, filters, folds, zoom, span, view and theme: all that was chosen is in the address."""
    path = browser.write("four", *four(folder / "logs", until=9000))
    with browser.page(path) as page:
        assert page.evaluate("location.hash") == f"#step={page.evaluate('STEP[now.row] + 1')}"
        page.evaluate("toggleCopies([...copies.keys()].find(isShown))")
        page.select_option("#station", "1001")
        page.check("#timers")
        page.fill("#text", "advertisement #&=1001")
        page.fill("#text", "advertisement")
        for key in ("t", "+", "o", "a", "D", "j", "j"):
            page.locator("#view").press(key)
        first, view = page.evaluate("location.hash"), page.evaluate(VIEW)
        assert view["time"] and view["follow"] and view["unfolded"] and view["logged"]
        page.evaluate("now.mark = now.shown.at(-1); zoomToSpan(); toggleTable();")
        second, spanned = page.evaluate("location.hash"), page.evaluate(VIEW)
        assert spanned["span"] and spanned["table"]
    for link, wanted in ((first, view), (second, spanned)):
        with browser.page(path, link) as page:
            found = page.evaluate(VIEW)
            assert found | {"scale": 0} == wanted | {"scale": 0}, link
            assert abs(found["scale"] / wanted["scale"] - 1) < 0.01


def a_followed_message_dims_the_rest(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("follow", *FOUR)) as page:
        page.evaluate("select(now.shown.find((row) => typeOf(row) === 'Intention'))")
        page.keyboard.press("o")
        page.evaluate("draw()")
        rows = page.eval_on_selector_all(
            "#svg .arrow[data-row], #svg .marks .row",
            "all => all.map((one) => [Number(one.dataset.row), one.classList.contains('dimmed')])",
        )
        wanted = page.evaluate("logged(now.row).message")
        for row, dimmed in rows:
            message = page.evaluate(f"logged({row}).message ?? null")
            assert dimmed == (message != wanted), (row, message)
        assert 2 <= sum(not dimmed for _, dimmed in rows) < len(rows) / 2
        page.keyboard.press("Escape")
        page.evaluate("draw()")
        assert page.locator("#svg .dimmed").count() == 0
        page.evaluate("select(now.shown[0])")
        arrow = boxes(page, "#svg .arrow.delivered line")[3]
        page.mouse.click(arrow["x"] + arrow["width"] / 2, arrow["y"] + arrow["height"] / 2)
        assert page.get_attribute("#follow", "aria-pressed") == "true", "a click on an arrow"


def real_time_has_a_ruler_and_long_waits_are_cut(browser: Browser, folder: Path) -> None:
    logs = simulated(folder / "logs", 1001, 2002, until=12_000, maneuver_ms=6000)
    with browser.page(browser.write("real", *logs)) as page:
        page.evaluate("select(0); toggleTime(); draw()")
        cuts = page.evaluate("cuts.map(({ from, to }) => [from, to])")
        assert cuts and max(to - after for after, to in cuts) > 4000
        rows = page.evaluate("now.shown.map((row) => [CLOCK[row], down(row)])")
        scale = page.evaluate("now.scale")
        for (t, y), (u, z) in pairwise(rows):
            tall = 40 if [t, u] in cuts else (u - t) * scale
            assert abs(z - y - tall) < 0.01, (t, u)
            assert [t, u] in cuts or tall <= 160
        waves = page.locator("#svg .cut-words")
        told = [waves.nth(n).text_content() for n in range(waves.count())]
        assert told and all(word.startswith("+") and word.endswith(" s") for word in told)
        ticks = page.eval_on_selector_all(
            "#svg .lines .unit",
            "all => all.map((one) => [parseFloat(one.textContent), Number(one.getAttribute('y'))])",
        )
        begin, top = page.evaluate("[CLOCK[0], view.scrollTop - HEAD]")
        assert len(ticks) > 3
        for seconds, y in ticks:
            at = page.evaluate(f"downTo({begin + 1000 * seconds})") - top
            assert abs(at - (y - 4)) < 1, seconds


def a_message_is_copied_as_json(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("copy", *FOUR)) as page:
        page.evaluate("navigator.clipboard.writeText = (words) => { window.copied = words; }")
        page.evaluate("select(now.shown.find((row) => typeOf(row) === 'Prescription'))")
        page.click("#step .copy")
        message = page.evaluate("logged(now.row).message")
        assert json.loads(page.evaluate("window.copied")) == message
        assert page.inner_text("#step .copy") == "Copied"


def _saved(page: Any, button: str) -> bytes:
    with page.expect_download() as download:
        page.click(button)
    content: bytes = download.value.path().read_bytes()
    return content


def pictures_have_a_legend(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("picture", *FOUR)) as page:
        svg = _saved(page, "#save-svg").decode()
        words = page.eval_on_selector_all("#legend li", "all => all.map((one) => one.textContent)")
        drawn = [f">{word.lstrip('?')}</text>" for word in words]
        assert all(word in svg for word in drawn) and len(words) > 5, words
        png = _saved(page, "#save-png")
        wide, tall = struct.unpack(">II", png[16:24])
        size = page.evaluate("[svg.clientWidth, svg.clientHeight]")
        assert png[:4] == b"\x89PNG" and wide == 2 * size[0] and tall > 2 * size[1]


def a_diagram_of_mermaid_has_whole_words(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("mermaid", *FOUR)) as page:
        text = page.evaluate("mermaidText()")
        assert " no. 1" in text and "no. " not in text.replace(" no. ", "") and "#" not in text
