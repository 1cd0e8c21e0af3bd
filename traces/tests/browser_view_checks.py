"""What must hold of the view of a page: its times, columns, spans, copies and keys."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

from browser_pages import EPOCH_MS, LAST_MS, four
from browser_stage import Browser, boxes, overlapping, two
from merged_runs import later, records, simulated
from page_rows import FOUR

from automcm_spec.vocabulary.application import Phase

GUTTER_TEXTS = """() => [...document.querySelectorAll("#svg .gutter text, #svg .heads .unit")]
  .map((one) => one.getBoundingClientRect()).map((r) => [r.x, r.y, r.right, r.bottom])"""


def _shown_times(page: Any) -> dict[int, int]:
    """By step the time beside it."""
    found = page.eval_on_selector_all(
        "#svg .gutter .step",
        "all => all.map((one) => ['number', 'time'].map((name) =>"
        " Number(one.querySelector(`.${name}`).textContent)))",
    )
    return dict(found)


def times_are_64_bit_and_count_from_the_start(browser: Browser, folder: Path) -> None:
    lines = records(simulated(folder / "zero", 1001, 2002, until=3000)[0])
    last = max(line.get("deadline", line.get("t_ms", 0)) for line in lines)
    for by_ms in (0, EPOCH_MS, LAST_MS - last):
        (log, _) = simulated(folder / str(by_ms), 1001, 2002, until=3000)
        later(log, by_ms)
        events = records(log)[1:-1]
        path = browser.write(f"at-{by_ms}", log)
        with browser.page(path, "#step=20") as page:
            page.check("#cams")
            assert page.evaluate("Array.from({length: COUNT}, (_, row) => logged(row))") == events
            for after in ("", "&time=logged"):
                begun = 0 if after else events[0]["t_ms"]
                page.evaluate("draw()")
                shown = _shown_times(page)
                wanted = {step: events[step - 1]["t_ms"] - begun for step in shown}
                assert len(shown) > 10 and shown == wanted, (by_ms, after)
                assert not overlapping(page.evaluate(GUTTER_TEXTS)), (by_ms, after)
                row = boxes(page, "#svg .row .mark")[0]
                right = max(box[2] for box in page.evaluate(GUTTER_TEXTS))
                assert right < row["x"], "the times stand left of the first column"
                assert page.evaluate("location.hash") == f"#step=20&cams=1{after}"
                page.keyboard.press("a")
        with browser.page(path, "#step=20&time=logged") as page:
            assert page.get_attribute("#logged", "aria-pressed") == "true"
            assert _shown_times(page)[20] == events[19]["t_ms"]


def times_of_two_runs_are_those_of_the_first(browser: Browser, folder: Path) -> None:
    with browser.page(two(browser, folder)) as page:
        page.check("#cams")
        rows = page.evaluate(
            """[...Array(COUNT).keys()].filter((row) => runOf(row) === 0)
            .map((row) => [Number(timeText(row)), logged(row).t_ms])"""
        )
        assert len({logged - shown for shown, logged in rows}) == 1, "A has one clock"


# -- spans


def _four(browser: Browser, folder: Path, **how: Any) -> Any:
    return browser.page(browser.write("four", *FOUR), **how)


def time_between_two_events_is_measured(browser: Browser, folder: Path) -> None:
    """Of one log on its clock, else on the clock of the first log."""
    with _four(browser, folder, after="#step=40") as page:
        rows = page.evaluate(
            "now.shown.map((row) => [STEP[row] + 1, TIME[row], ROW.log[row], logged(row).t_ms])"
        )
        begun, marked = next((n, one) for n, one in enumerate(rows) if one[0] == 40)
        for on in range(1, 12):
            for key in ("m", *["j"] * on) if on % 2 else ["Shift+ArrowDown"] * on:
                page.keyboard.press(key)
            there = rows[begun + on]
            clock = 3 if there[2] == marked[2] else 1
            words = f"{there[clock] - marked[clock]:,} ms from step 40 to {there[0]}"
            assert page.inner_text("#span-words") == words
            page.keyboard.press("Escape")
            assert page.is_hidden("#span")
            page.evaluate(f"select(now.shown[{begun}])")
        marks = page.locator("#svg .marks .row .mark")
        marks.nth(3).click()
        first = int(page.inner_text("#where").split()[0])
        marks.nth(9).click(modifiers=["Shift"])
        last = int(page.inner_text("#where").split()[0])
        assert f"from step {first} to {last}" in page.inner_text("#span-words") and first < last


def a_span_is_dragged_and_shown_alone(browser: Browser, folder: Path) -> None:
    with _four(browser, folder) as page:
        page.keyboard.press("Home")
        for key, left in (("", 60), ("t", 60), ("", 700)):
            if key:
                page.keyboard.press(key)
            page.evaluate("draw()")
            rows = page.evaluate(
                """(() => { const y = (row) => down(row) - view.scrollTop + HEAD, a = now.shown[3];
                const b = now.shown.find((row) => y(row) > y(a) + 100);
                return [[a, y(a)], [b, y(b)]]; })()"""
            )
            box = page.locator("#svg").bounding_box()
            (a, top), (b, bottom) = rows
            page.mouse.move(box["x"] + left, box["y"] + top)
            page.mouse.down()
            page.mouse.move(box["x"] + left, box["y"] + (top + bottom) / 2)
            page.mouse.move(box["x"] + left, box["y"] + bottom)
            page.mouse.up()
            span, shown = page.evaluate("[now.span, now.shown]")
            assert shown[0] == span[0] and shown[-1] == span[1] > span[0]
            clock = page.evaluate(f"[{a}, now.span[0], {b}, now.span[1]].map((row) => CLOCK[row])")
            assert clock[0] == clock[1] and clock[2] == clock[3]
            assert page.evaluate("now.time") or span == [a, b]
            height, window = page.evaluate("[heightOfAll(), view.clientHeight]")
            assert height <= window, "the whole span is in the window"
            assert height > window / 2 or not page.evaluate("now.time"), "and fills it"
            page.keyboard.press("0")
            assert page.evaluate("now.span") is None
        page.keyboard.press("m")
        page.keyboard.press("PageDown")
        page.keyboard.press("z")
        assert page.is_enabled("#span-whole")
        page.click("#span-whole")
        assert page.is_hidden("#span")


# -- columns


def _columns(page: Any) -> list[tuple[int, float, float]]:
    found = page.evaluate("COLUMNS.map((_, n) => [n, layout.x[n], layout.width[n]])")
    return sorted((one for one in found if one[2]), key=lambda one: one[1])


def columns_are_moved_and_resized(browser: Browser, folder: Path) -> None:
    with _four(browser, folder) as page:
        page.keyboard.press("Home")
        own = page.evaluate("ROW.log[now.row]")
        begun = _columns(page)
        width = next(one[2] for one in begun if one[0] == own)
        page.keyboard.press(">")
        assert [n for n, *_ in _columns(page)].index(own) == 1
        page.keyboard.press("<")
        page.keyboard.press(".")
        assert page.evaluate(f"layout.width[{own}]") == width + 16
        page.keyboard.press(",")
        page.keyboard.press("]")
        page.keyboard.press("[")
        assert _columns(page) == begun
        box = page.locator("#svg").bounding_box()
        edge, other = begun[0][1] + begun[0][2], begun[2][1] + begun[2][2] * 0.7
        _drag(page, box, edge, edge + 40)
        assert _columns(page)[0][2] == begun[0][2] + 40
        page.keyboard.press("r")
        assert _columns(page) == begun
        _drag(page, box, begun[0][1] + begun[0][2] / 2, other)
        assert [n for n, *_ in _columns(page)] == [begun[n][0] for n in (1, 2, 0, 3)]
        words = page.evaluate("layout.text[0] + layout.words")
        page.keyboard.press("r")
        _drag(page, box, words, words - 60)
        assert page.evaluate("layout.text[0] + layout.words") == words - 60


def _drag(page: Any, box: Any, x: float, to: float) -> None:
    page.mouse.move(box["x"] + x, box["y"] + 12)
    page.mouse.down()
    for part in range(1, 9):
        page.mouse.move(box["x"] + x + (to - x) * part / 8, box["y"] + 12)
    page.mouse.up()


def phases_are_bands_of_the_states(browser: Browser, folder: Path) -> None:
    """Each with the phase that the specification gives the station there, which its title names."""
    with _four(browser, folder) as page:
        coloured = page.evaluate("PHASE_NAMES.map((name) => name.toUpperCase())")
        assert sorted(coloured) == sorted(set(get_args(Phase)) - {"STANDALONE"})
        named = set()
        for part in range(12):
            page.evaluate(f"view.scrollTop = view.scrollHeight * {part} / 12; draw()")
            bands = page.evaluate(
                """[...document.querySelectorAll("#svg .phase")].map((band) => {
                const tint = band.querySelector(".tint").getBoundingClientRect();
                return [band.textContent, tint.left, tint.right, tint.top, tint.bottom]; })"""
            )
            rows = page.evaluate(
                """[...document.querySelectorAll("#svg .marks .row")].map((one) => {
                const row = Number(one.dataset.row), log = ROW.log[row], step = stepAt(log, row);
                const {x, y, width, height} = one.querySelector(".mark").getBoundingClientRect();
                return [step < 0 ? "" : stateAfter(log, step).state.phase, station(row),
                  x + width / 2, y + height / 2, down(row) - view.scrollTop + HEAD]; })"""
            )
            for phase, station, x, y, at in rows:
                at_it = [b[0] for b in bands if b[1] < x < b[2] and b[3] <= y <= b[4]]
                wanted = [] if phase in ("", "STANDALONE") else [f"{station}: {phase}"]
                assert at_it == wanted or not 40 < at < 600, (phase, station, at_it)
                named |= set(at_it)
        assert len({name.split()[1] for name in named}) >= 5, named


# -- keys


def every_key_of_the_help_does_what_it_says(browser: Browser, folder: Path) -> None:
    """At least: each has an action, and each action is in the help."""
    with _four(browser, folder) as page:
        page.keyboard.press("?")
        assert page.is_visible("#keys")
        shown = page.eval_on_selector_all("#keys kbd", "all => all.map((one) => one.textContent)")
        page.keyboard.press("Escape")
        assert page.is_hidden("#keys")
        given = set(page.evaluate("Object.keys(ACTIONS)"))
        names = {"←": "ArrowLeft", "→": "ArrowRight", "↑": "ArrowUp", "↓": "ArrowDown"}
        names |= {
            "\u2212": "-",
            "Esc": "Escape",
            "Space": " ",
            "Page Up": "PageUp",
            "Page Down": "PageDown",
        }
        told = set()
        for line in shown:
            if line.startswith(("Shift", "Tab")):
                continue
            whole = [p.strip() for p in line.replace(", .", "comma .").split(",")]
            for part in whole:
                keys = [part] if part in names else part.split()
                told |= {names.get(key, "," if key == "comma" else key) for key in keys}
        assert told == given - {"f"}, told ^ given


# -- copies


def copies_are_folded_into_one_row(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("copies", *four(folder / "logs", until=6000))) as page:
        sent = page.evaluate(
            """[...Array(COUNT).keys()].filter((row) => station(row) === 1001
            && DATA.rows.kinds[row] === "s" && text(row).startsWith("Advertisement"))"""
        )
        rows = "[...Array(COUNT).keys()].filter(isShown)"
        shown = page.evaluate(rows)
        count = {row: page.evaluate(f"copies.get({row}) ?? 0") for row in sent if row in shown}
        assert len(count) < len(sent)
        assert len(count) + sum(count.values()) == len(sent), "each is there or counted"
        head = next(row for row in count if count[row])
        page.evaluate(f"select({head})")
        page.evaluate("draw()")
        badge = page.locator(f'#svg .row[data-row="{head}"] .copies')
        assert badge.text_content() == f"▸ \u00d7{count[head] + 1}"
        for unfold in (lambda: page.keyboard.press("x"), badge.click):
            unfold()
            page.evaluate("draw()")
            assert badge.text_content() == f"▾ \u00d7{count[head] + 1}"
            more = set(page.evaluate(rows)) - set(shown)
            assert sum(row in sent for row in more) == count[head]
            unfold()
            assert page.evaluate(rows) == shown
        page.keyboard.press("X")
        everything = page.evaluate(rows)
        assert set(sent) <= set(everything) and page.is_checked("#copies")
        arrivals = page.evaluate(
            """arrows.filter((a) => a.last > a.first && !(ROW.flags[a.first] & IS_CAM))
            .map((a) => [a.first, a.last, text(a.last) + station(a.last)])"""
        )
        firsts = {words: last for _, last, words in sorted(arrivals, key=lambda one: -one[1])}
        assert set(firsts.values()) <= set(shown), "what arrives first is not folded"
