"""What a page shows of a run without a click: losses, hazards, missing messages, names."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from unittest.mock import patch

from browser_pages import four
from browser_stage import Browser, boxes
from merged_runs import killed, records, rewritten, simulated
from page_rows import CORPUS, FOUR

from automcm.links.simulated_radio import Radio
from automcm_cli.trace.trace_html import page_of
from automcm_spec.log_format.reader import read
from automcm_spec.model_checking import models
from automcm_traces.system.log_merge import merge
from automcm_traces.viewer.page import html
from automcm_traces.viewer.page_data import load

COUNTEREXAMPLES = Path(__file__).parents[1] / "counterexamples"
TEXTS = "all => all.map((one) => one.textContent)"


def _words(page: Any, selector: str) -> list[str]:
    page.evaluate("draw()")
    found: list[str] = page.eval_on_selector_all(selector, TEXTS)
    return found


def _until(page: Any, expression: str, most_ms: int = 5000) -> None:
    """Wait until an expression is true; the page's policy forbids ``wait_for_function``."""
    for _ in range(most_ms // 50):
        if page.evaluate(expression):
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"never so: {expression}")


def losses_are_seen_without_a_click(browser: Browser, folder: Path) -> None:
    """In the row of folded copies, the minimap, the bar of the verdict and the matrix of links."""
    logs = four(folder / "logs", until=9000)
    lost = sum(a.fate == "lost" for a in merge([read(log) for log in logs]).arrows())
    with browser.page(
        browser.write("loss", *logs), viewport={"width": 1400, "height": 4000}
    ) as page:
        assert lost > 100 and f"{lost} lost" in page.inner_text("#verdict")
        of_rows = page.evaluate("now.shown.map((row) => lossesOf(row))")
        folded = page.evaluate(
            "now.shown.filter(holdsCopies).map((row) => [lossesOfAll[row], losses[row]])"
        )
        assert any(together > own > 0 for together, own in folded)
        shown = [int(one.split()[0]) for one in _words(page, "#svg .row .lost")]
        assert shown == [n for n in of_rows if n][: len(shown)] and len(shown) > 10
        page.check("#cams")
        assert sum(page.evaluate("now.shown.map((row) => lossesOf(row))")) == lost
        page.uncheck("#cams")
        wrong = page.evaluate("colour('--wrong')").lstrip("#")
        pixels = page.evaluate(
            """(wrong) => { const { width, height } = small;
            const found = small.getContext("2d").getImageData(0, 0, width, height).data;
            return [...Array(width * height).keys()].filter((n) => [0, 1, 2].every((k) =>
              found[4 * n + k] === parseInt(wrong.slice(2 * k, 2 * k + 2), 16))).length; }""",
            wrong,
        )
        assert pixels > 100, "the minimap is red where messages were lost"
        cells = page.eval_on_selector_all(".matrix td .lost", TEXTS)
        assert len(cells) == 12 and sum(int(cell.split()[0]) for cell in cells) == lost


def rows_are_chosen_by_fate(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("fate", *FOUR)) as page:
        offered = page.eval_on_selector_all("#fate option", TEXTS)
        assert offered[0] == "all" and {"delivered", "lost", "duplicate"} <= set(offered)
        page.select_option("#fate", "lost")
        rows = page.evaluate("now.shown.map((row) => lossesOf(row))")
        assert len(rows) > 2 and all(rows), "the selected step is one of them, too"
        page.select_option("#fate", "duplicate")
        assert page.evaluate("now.shown.every((row) => fatesOf(row) & (1 << DUPLICATE))")


def a_hazard_is_a_band_over_both_stations(browser: Browser, folder: Path) -> None:
    logs = simulated(folder / "logs", 1001, 2002, 3003, until=10_000)
    killed(logs[1], 4000)
    size = {"width": 1800, "height": 800}
    with browser.page(browser.write("hazard", *logs), viewport=size) as page:
        (hazard,) = page.evaluate("RUNS[0].system.hazards")
        page.evaluate("select(HAZARDS[0].ends[0])")
        (words,) = _words(page, "#svg .hazard-words")
        length, bound = hazard["length"]["ms"], hazard["bound_ms"]
        assert f"{length:,} " in words and words.endswith(f"{bound:,} ms"), words
        columns = boxes(page, "#svg .hazard rect")
        assert len(columns) == 2 and columns[0]["height"] == columns[1]["height"] > 10
        names = page.evaluate("HAZARDS[0].columns.map((n) => COLUMNS[n].station)")
        assert names == [hazard["prescriber"], hazard["target"]] == [1001, 2002]
        shown = page.evaluate("HAZARDS[0].ends.map(isShown)")
        assert shown == [True, True], "also where timers are hidden"
        stops = page.locator("#svg .stops")
        assert stops.count() == 1 and "2002 stops here" in stops.text_content()
        (mark,) = boxes(page, "#svg .stops")
        assert columns[1]["x"] < mark["x"] < columns[1]["x"] + columns[1]["width"]


def a_missing_message_is_drawn_where_it_was_due(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("due", CORPUS / "bad" / "ack_missing.ndjson")) as page:
        due = page.locator("#svg .arrow.due")
        assert due.count() == 1 and "missing: Ack to 2002" in due.text_content()
        assert "dash" in page.evaluate(
            "getComputedStyle(document.querySelector('.arrow.due')).strokeDasharray"
            ".replace(/^[1-9].*/, 'dash')"
        )
        (ends,) = boxes(page, "#svg .arrow.due line")
        column = page.evaluate("[lifeline(0), lifeline(1)]")
        left = page.locator("#view").bounding_box()["x"]
        assert abs(ends["x"] - left - column[0]) < 8
        assert abs(ends["x"] + ends["width"] - left - column[1]) < 8
    with browser.page(browser.write("busy", CORPUS / "bad" / "busy_accepted.ndjson")) as page:
        assert page.locator("#svg .arrow.due").count() == 0, "another message, and none is missing"


def timers_are_bars_and_no_rows(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("timers", *FOUR)) as page:
        assert not page.is_checked("#timers")
        without, bars = page.evaluate("now.shown.length"), page.locator("#svg .bar").count()
        kinds = page.evaluate("now.shown.filter((row) => kind(row) === 'timer').map(phaseChange)")
        assert bars > 3 and kinds and all(kinds), "what changes a phase is not hidden"
        page.check("#timers")
        assert page.evaluate("now.shown.length") > without * 1.2


def arrows_say_what_they_carry_where_there_is_room(browser: Browser, folder: Path) -> None:
    for width, some in ((1400, True), (390, False)):
        size = {"width": width, "height": 800}
        with browser.page(browser.write("labels", *FOUR), viewport=size) as page:
            labels = boxes(page, "#svg .arrow .label")
            assert (len(labels) > 8) == some, (width, len(labels))
            for n, a in enumerate(labels):
                for b in labels[n + 1 :]:
                    apart = abs(a["y"] - b["y"]) >= 10
                    assert apart or a["x"] + a["width"] < b["x"] or b["x"] + b["width"] < a["x"]
            if some:
                assert {"Advertisement", "Intention", "Ack"} <= set(_words(page, ".arrow .label"))


def heads_say_name_and_role(browser: Browser, folder: Path) -> None:
    logs = simulated(folder / "logs", 1001, 2002, until=6000)
    lines = records(logs[1])
    lines[0]["x_name"] = "van"
    rewritten(logs[1], lines)
    with browser.page(browser.write("heads", *logs)) as page:
        assert _words(page, "#svg .heads .name") == ["1001 · prescriber", "van (2002) · receiver"]


def an_overheard_message_says_for_whom_it_is(browser: Browser, folder: Path) -> None:
    """On a shared radio each hears what is meant for the others."""
    send = Radio._send
    with patch.object(Radio, "_send", lambda self, src, data, _, tx: send(self, src, data, 0, tx)):
        logs = simulated(folder / "logs", 1001, 2002, 3003, until=4000)
    with browser.page(browser.write("overheard", *logs)) as page:
        rows = page.evaluate(
            "now.shown.filter((row) => kind(row) === 'receive' && body(row).message?.dst)"
            ".map((row) => [rowText(row), body(row).message.dst, station(row)])"
        )
        assert sum(dst != own for _, dst, own in rows) > 8, rows
        for words, dst, own in rows:
            assert (f" for {dst}" in words) == (dst != own), (words, dst, own)


def allowed_logs_are_one_line(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("four", *FOUR)) as page:
        badges = page.locator("#judged > details").first
        assert badges.locator("summary").first.inner_text().endswith(f"{len(FOUR)} logs")
        assert not page.is_visible("#judged .verdict")


def the_filters_apply_to_the_selected_step(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("type", *FOUR), "#step=60") as page:
        page.select_option("#type", "Prescription")
        assert page.evaluate("now.shown.every((row) => typeOf(row) === 'Prescription')")
        assert page.evaluate("isShown(now.row) && now.shown.length") > 1
        page.fill("#text", "Prescription")
        wide = page.evaluate(
            "(() => { const box = document.getElementById('text');"
            " return box.scrollWidth <= box.clientWidth; })()"
        )
        assert wide, "the field is wide enough for the longest type"


def a_counterexample_says_what_it_shows(browser: Browser, folder: Path) -> None:
    """The mechanism taken away, its replacement as the specification, the property and the row."""
    for cfg, broken, operator in (
        ("no_busy_refusal", "S-1", "OnForeignPrescription is replaced by NoBusyRefusal"),
        ("no_quarantine", "S-4", "Quarantined is replaced by NoQuarantine"),
    ):
        path = browser.folder / f"{cfg}.html"
        path.write_bytes(html(page_of([COUNTEREXAMPLES / f"{cfg}.itf.json"], None)))
        with browser.page(path) as page:
            model = next(each for each in models.load() if each.cfg == cfg)
            part = page.inner_text("#counterexample")
            assert all(words in part for words in (model.why, broken, operator, "Ablations.tla:"))
            assert f"in the last of {model.length} states" in part
            assert f"VIOLATES {broken}" in page.inner_text("#verdict")
            quoted = page.eval_on_selector_all("#step .source.modified", TEXTS)
            assert any(operator.split()[-1] in text for text in quoted)
            page.click("#counterexample .link")
            assert page.evaluate("now.row === VIOLATIONS[0].row && now.row >= COUNT - 3")
            assert f"✗ {broken} is violated" in page.evaluate("rowText(now.row)")


def _with_traffic(folder: Path, logs: list[Path]) -> Path:
    """A page of logs with road users that move by 10 m a second."""
    users = [
        {"number": number, "equipped": True, "length_mm": 4500, "width_mm": 1800}
        for number in (1001, 2002, 9)
    ]
    frames = [
        {
            "number": [1001, 2002, 9],
            "x_mm": [2000 * n, 2000 * n + 20_000, 2000 * n - 30_000],
            "y_mm": [0, 3500, 0],
            "heading_mrad": [0, 0, 0],
        }
        for n in range(60)
    ]
    (folder / "traffic.json").write_text(
        json.dumps({"every_ms": 200, "users": users, "frames": frames})
    )
    page = load(logs)
    page.traffic = folder / "traffic.json"
    path = folder / "traffic.html"
    path.write_bytes(html(page))
    return path


def the_traffic_is_across_the_top_and_moves_with_the_step(browser: Browser, folder: Path) -> None:
    path = _with_traffic(folder, simulated(folder / "logs", 1001, 2002, until=6000))
    with browser.page(path, viewport={"width": 1400, "height": 900}) as page:
        above, main = (page.locator(part).bounding_box() for part in ("#above", "main"))
        assert (
            above["width"] > 1300
            and above["height"] < 200
            and above["y"] + above["height"] <= main["y"] + 1
        )
        assert page.locator("#above .vehicle").count() == 3
        told = page.get_attribute("#above .road", "aria-label")
        assert "1001 at" in told and "2002 at" in told
        page.evaluate("select(COUNT - 1)")
        later = page.get_attribute("#above .road", "aria-label")
        assert later != told
        page.evaluate("select(0)")
        begun = page.get_attribute("#above .road", "aria-label")
        page.keyboard.press(" ")
        assert page.get_attribute("#play", "aria-pressed") == "true"
        _until(page, "now.row > 0")
        _until(page, f"document.querySelector('#above .road').ariaLabel !== '{begun}'")
        page.keyboard.press(" ")
        rested = page.evaluate("now.row")
        page.wait_for_timeout(500)
        assert page.evaluate("now.row") == rested, "it has paused"


def without_traffic_play_goes_on_by_steps_to_the_end(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("play", *FOUR)) as page:
        assert page.is_hidden("#above")
        page.evaluate("select(now.shown.at(-4))")
        page.click("#play")
        _until(page, "now.row === now.shown.at(-1)")
        _until(page, "document.getElementById('play').textContent === 'Play'")


def two_runs_differ_in_no_message_for_others(browser: Browser, folder: Path) -> None:
    """In the second run a station overhears a message that is for another (MSG-1)."""
    a, b = (simulated(folder / run, 1001, 2002, 3003, until=4000) for run in "ab")
    lines = records(b[2])
    sent = next(
        r for r in records(b[0]) if r.get("ev") == "send" and r["message"].get("dst") == 2002
    )
    at = next(n for n, r in enumerate(lines) if r.get("t_ms", 0) > sent["t_ms"])
    heard = {name: sent[name] for name in ("rec", "t_ms", "tx", "message")} | {"ev": "receive"}
    rewritten(b[2], [*lines[:at], heard, *lines[at:]])
    with browser.page(browser.write_two("others", a, b)) as page:
        assert page.evaluate("DIFFERENCE") is None or page.evaluate("DIFFERENCE === Infinity")
