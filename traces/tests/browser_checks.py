"""What must hold of a page in a browser: each function is a check, by its name."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from browser_stage import Browser, run, two
from merged_runs import killed, records, rewritten, simulated
from page_rows import CORPUS, FOUR
from test_page import HOSTILE, with_text

from automcm_spec.log_format.reader import read
from automcm_traces.explain.explain import verdict_of
from automcm_traces.viewer import page_part

SECURED = sorted((CORPUS / "secured").glob("*.ndjson"))
MOST_ROWS = 200
"""No redrawing may draw more, however many events there are: only what is near the window."""
LARGE_MS = 920_000
"""Simulated: three stations then have logged nearly 100,000 events; more a page refuses."""


# -- what is checked; each by its name


def the_verdict_is_that_of_explain(browser: Browser, folder: Path) -> None:
    for entry in json.loads((CORPUS / "index.json").read_text()):
        log = CORPUS / entry["file"]
        verdict = verdict_of(log)
        if verdict.verdict != "diverges" or log.parent.name != "bad":
            continue
        with browser.page(browser.write(log.stem, log)) as page:
            assert "DIVERGES" in page.inner_text("#verdict")
            told = page.inner_text("#judged").replace("\n", " ")
            assert "\\u000a" not in told, "a line feed of our own is not foreign"
            for words in (
                verdict.finding.observed,
                *verdict.finding.expected,
                verdict.finding.guard,
                verdict.finding.state,
            ):
                assert " ".join(words.split()) in " ".join(told.split()), (log.name, words)
            wrong = page.text_content("#svg .row text:text-matches('^✗')")
            assert wrong.startswith("✗"), log.name
            assert page.inner_text("#step > details:first-child").startswith("Step ")


def a_hint_at_the_log_is_shown(browser: Browser, folder: Path) -> None:
    lines = [json.loads(line) for line in (CORPUS / "pair/2002.ndjson").read_text().splitlines()]
    path = folder / "unplanned.ndjson"
    for one in lines:
        one.pop("planned", None)
    path.write_text("".join(json.dumps(one) + "\n" for one in lines))
    verdict = verdict_of(path)
    assert verdict.verdict == "diverges" and verdict.hint
    with browser.page(browser.write("hint", path)) as page:
        told = page.inner_text("#judged")
        assert " ".join(verdict.hint.split()) in " ".join(told.split())


def every_kind_of_arrow_is_drawn(browser: Browser, folder: Path) -> None:
    logs = run(folder / "arrows", 10_000)
    killed(logs[1], 8000)
    logs[2].unlink()
    with browser.page(browser.write("arrows", *logs[:2])) as page:
        page.check("#cams")
        found: set[str] = set()
        for part in range(40):
            page.evaluate(f"view.scrollTop = view.scrollHeight * {part} / 40; draw()")
            names = page.eval_on_selector_all(
                "#svg .arrow", "all => all.map(one => one.getAttribute('class'))"
            )
            found |= {name.split()[1] for name in names}
        assert found >= {"delivered", "lost", "duplicate", "unobserved", "in-flight"}, found
        shapes = page.eval_on_selector_all("#legend li", "all => all.map(one => one.textContent)")
        assert len(shapes) == 7


def rejected_messages_are_shown_by_their_cause(browser: Browser, folder: Path) -> None:
    letters = {"forged": "F", "replayed": "R", "stale": "S", "untrusted": "U"}
    with browser.page(browser.write("secured", *SECURED)) as page:
        page.set_viewport_size({"width": 1280, "height": 6000})
        assert page.inner_text("#rejected").split("\n") == ["all rows", "none", *letters]
        shown = page.eval_on_selector_all("#legend li", "all => all.map(one => one.textContent)")
        assert [x for x in shown if "rejected" in x] == [
            f"{letter}rejected: {name}" for name, letter in letters.items()
        ]
        for name, letter in letters.items():
            page.select_option("#rejected", name)
            rows = page.evaluate("now.shown.map(cause)")
            assert rows and set(rows) == {name}
            page.evaluate("draw()")
            drawn = page.eval_on_selector_all(
                f"#svg .arrow.rejected.{name} .sign", "all => all.map(one => one.textContent)"
            )
            assert set(drawn) == {letter}
            page.evaluate("select(now.shown.find(row => cause(row)))")
            assert "rejected: " in page.inner_text("#step")
        page.select_option("#rejected", "none")
        assert page.evaluate("now.shown.length") > 20
        assert not any(page.evaluate("now.shown.map(cause)"))
    with browser.page(browser.write("plain", *FOUR)) as page:
        assert page.is_hidden("#rejected")


def a_hazard_is_where_the_page_opens(browser: Browser, folder: Path) -> None:
    """A station that acts dies: every log is allowed, but its prescriber acts on alone."""
    logs = simulated(folder, 1001, 2002, until=10_000)
    killed(logs[1], 4000)
    path = browser.write("hazard", *logs)
    with browser.page(path) as page:
        opened = page.inner_text("#where")
        assert not opened.startswith("1 "), opened
        begins, ends = page.query_selector_all("#judged button.link")
        ends.click()
        assert page.inner_text("#where") != opened
        page.click("#divergence")
        assert page.inner_text("#where") == opened
        assert page.inner_text("#divergence") == "Hazard" and "from" in begins.inner_text()


def an_arrow_longer_than_the_window_is_drawn(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("long", *FOUR)) as page:
        page.evaluate(
            "arrows.unshift({first: 0, last: COUNT - 1, kind: LOST, from: 0, to: 1}),"
            "arrowReach.splice(0, arrowReach.length, ...reach(arrows)),"
            "view.scrollTop = view.scrollHeight / 2"
        )
        page.evaluate("draw()")
        found = page.evaluate("touching(arrows, arrowReach, COUNT / 2, COUNT / 2 + 9)")
        assert any(arrow["first"] == 0 for arrow in found)


def steps_lead_forward_and_back_to_the_same_state(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("steps", *FOUR), "#step=90") as page:
        page.check("#copies")
        page.check("#timers")
        before, states = page.inner_text("#step"), []
        for _ in range(150):
            page.keyboard.press("l")
            states.append(page.inner_text("#step"))
        assert len(set(states)) == 150
        for n in range(150):
            assert page.inner_text("#step") == states[-1 - n]
            page.keyboard.press("h" if n % 2 else "ArrowLeft")
        assert page.inner_text("#step") == before


def states_from_deltas_are_those_of_the_log(browser: Browser, folder: Path) -> None:
    from automcm_traces.checker.follow import Check
    from automcm_traces.viewer.page_follow import States

    with browser.page(browser.write("states", FOUR[0])) as page:
        log, states = read(FOUR[0]), States(range(10**9))
        Check(log, watchers=[states]).read()
        followed = states.history(log)
        for step in range(len(followed.steps)):
            assert page.evaluate(f"stateAfter(0, {step}).state") == followed.state(step), step
        events = page.evaluate("Array.from({length: COUNT}, (_, row) => logged(row))")
        assert events == records(FOUR[0])[1:-1]


def a_link_leads_to_its_step(browser: Browser, folder: Path) -> None:
    path = browser.write("links", *FOUR)
    with browser.page(path, "#step=41") as page:
        assert page.inner_text("#where").startswith("41 /")
        page.keyboard.press("j")
        moved = page.evaluate("location.hash")
        page.evaluate("location.hash = '#step=7'")
        page.wait_for_function("document.getElementById('where').textContent.startsWith('7 /')")
    with browser.page(path, moved) as page:
        assert f"#step={page.inner_text('#where').split()[0]}" == moved
    with browser.page(path, "#step=99999999") as page:
        assert page.inner_text("#where").split()[0] == page.inner_text("#where").split()[2]


def filters_leave_what_they_name(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("filters", *FOUR)) as page:
        page.select_option("#type", "Fin")
        words = page.evaluate("now.shown.map(text)")
        assert words and all("Fin" in one for one in words)
        page.select_option("#type", "")
        page.keyboard.press("/")
        page.keyboard.type("prescription")
        words = page.evaluate("now.shown.map(text)")
        assert all("Prescription" in one for one in words)


def foreign_text_stays_text(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("hostile", with_text(folder, HOSTILE)), "#step=2") as page:
        page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        assert page.locator("img").count() == 0
        assert "<img src=x" in page.inner_text("#step")
        assert "\u202e" not in page.inner_text("body")
        page.keyboard.press("b")
        assert page.locator("#table tr").count() > 10
    with browser.page(
        browser.write("long-text", with_text(folder, "a" * 100_000)), "#step=2"
    ) as page:
        assert "more characters" in page.text_content("#panel")


def ten_thousand_stations_leave_the_page_alive(browser: Browser, folder: Path) -> None:
    lines = records(FOUR[0])
    fields = {"v": 1, "type": "CAM", "generation_ms": 0, "x_mm": 0, "y_mm": 0}
    fields |= {"heading_mrad": 0, "speed_mm_s": 0, "marks": []}
    cams = [
        {"rec": "event", "t_ms": 0, "ev": "receive", "message": fields | {"src": 10_000 + n}}
        for n in range(10_000)
    ]
    rewritten(folder / "many.ndjson", [lines[0], *cams, *lines[1:]])
    with browser.page(browser.write("many", folder / "many.ndjson")) as page:
        page.check("#cams")
        page.keyboard.press("End")
        assert page.inner_text("#where").split()[0] == page.inner_text("#where").split()[2]


def what_is_downloaded_is_whole(browser: Browser, folder: Path) -> None:
    log = CORPUS / "bad" / "busy_accepted.ndjson"
    with browser.page(browser.write("downloads", log)) as page:
        got = {}
        for name in ("save-svg", "save-log", "save-mermaid"):
            with page.expect_download() as download:
                page.click(f"#{name}")
            got[name] = Path(download.value.path()).read_text()
        root = ElementTree.fromstring(got["save-svg"])
        assert root.tag.endswith("svg") and "var(--" not in got["save-svg"]
        (folder / "prefix.ndjson").write_text(got["save-log"])
        again, first = verdict_of(folder / "prefix.ndjson"), verdict_of(log)
        assert (again.verdict, again.finding.at.line, again.finding.rule) == (
            first.verdict,
            first.finding.at.line,
            first.finding.rule,
        )
        assert got["save-mermaid"].startswith("sequenceDiagram\n")


def real_time_keeps_the_step_in_the_window(browser: Browser, folder: Path) -> None:
    with browser.page(browser.write("time", *FOUR), "#step=300") as page:
        for key in ("t", "+", "+", "-", "t"):
            page.keyboard.press(key)
            page.evaluate("draw()")
            assert page.locator("#svg .band.selected").count() == 1, key


def without_javascript_there_is_the_table(browser: Browser, folder: Path) -> None:
    path = browser.write("plain", FOUR[0])
    with browser.page(path, java_script_enabled=False) as page:
        assert "ALLOWED" in page.inner_text("noscript")
        assert page.locator("noscript tbody tr").count() == len(records(FOUR[0])) - 2


def nothing_else_may_run_or_load(browser: Browser, folder: Path) -> None:
    path = browser.write("policy", FOUR[0])
    with browser.page(path) as page:
        blocked = page.evaluate(
            """async () => {
              const script = document.createElement("script");
              script.textContent = "window.ran = true";
              document.body.append(script);
              const loaded = await fetch(location.href).then(() => true, () => false);
              return [window.ran === undefined, !loaded];
            }"""
        )
        assert blocked == [True, True]
    expected = [
        p for p in browser.problems if p.startswith("policy.html") and "Content Security" in p
    ]
    assert len(expected) >= 2
    browser.problems = [p for p in browser.problems if not p.startswith("policy.html")]


def as_many_events_as_a_page_takes_open_and_scroll(browser: Browser, folder: Path) -> None:
    logs = run(folder / "large", LARGE_MS, 0.1, 74)
    path = browser.write("large", *logs)
    with browser.page(path) as page:
        count = page.evaluate("COUNT")
        page.wait_for_function("document.querySelectorAll('#svg .row').length > 5")
        opened = page.evaluate("performance.now()")
        page.check("#cams")
        slowest, rows = page.evaluate(
            """() => {
              const drawn = Array.from({length: 60}, (_, n) => {
                view.scrollTop = (view.scrollHeight * n) / 60;
                const begun = performance.now();
                draw();
                return [performance.now() - begun, svg.querySelectorAll(".row").length];
              });
              return [0, 1].map((n) => Math.max(...drawn.map((one) => one[n])));
            }"""
        )
    each = path.stat().st_size / count
    print(
        f"  {count} events: open after {opened:.0f} ms, slowest redrawing {slowest:.0f} ms, "
        f"at most {rows} rows, {each:.0f} bytes an event"
    )
    assert 0.99 * page_part.MOST_EVENTS < count <= page_part.MOST_EVENTS
    assert 5 < rows <= MOST_ROWS and each < 250


def two_runs_are_aligned_up_to_their_first_difference(browser: Browser, folder: Path) -> None:
    with browser.page(two(browser, folder)) as page:
        first = page.evaluate("DIFFERENCE")
        assert page.evaluate("now.row") == first, "the page opens there"
        words = page.text_content("#svg text.differs")
        assert words.startswith("≠ first difference, station ")
        shown = page.evaluate(
            "[difference(), document.querySelector('#step .differs').textContent]"
        )
        assert shown[0] in shown[1]
        line, row = (
            page.evaluate(f"document.querySelector('{one}').getBoundingClientRect().bottom")
            for one in ("#svg rect.differs", f'#svg .row[data-row="{first}"] .mark')
        )
        assert 0 < row - line < 25, "the line stands right above the row"
        before = page.evaluate(f"now.shown[now.before[{first}] - 1]")
        assert page.evaluate(f"down({first}) - down({before})") == page.evaluate("2 * HEIGHT")
        page.check("#copies")
        pairs = page.evaluate(
            """ROW.flags.reduce((all, _, row) => (isBeside(row) ? [...all,
            [down(row) - down(row - 1), CLOCK[row] - CLOCK[row - 1], runOf(row) - runOf(row - 1)]]
            : all), [])"""
        )
        assert len(pairs) > 50 and all(one == [0, 0, 1] for one in pairs)
        page.keyboard.press("Home")
        for key in ("t", "f"):
            page.keyboard.press(key)
        assert page.evaluate("[now.row, now.time]") == [first, True]
        assert page.locator("#svg rect.differs").count() == 1
        left, right = page.evaluate("layout.spans")
        assert left[0] + left[1] < right[0], "A stands left of B"
    same = browser.write_two("same", FOUR, FOUR)
    with browser.page(same) as page:
        assert "= the same" in page.inner_text("#verdict")
        assert page.is_disabled("#difference") and page.locator("text.differs").count() == 0


def steps_of_two_runs_lead_forward_and_back_to_the_same_state(
    browser: Browser, folder: Path
) -> None:
    path = two(browser, folder)
    with browser.page(path) as page:
        page.check("#copies")
        begun, states = page.evaluate("STEP[now.row] + 1"), [page.inner_text("#step")]
        for key in "h" * 40 + "l" * 80:
            page.keyboard.press(key)
            states.append(page.inner_text("#step"))
        assert states[:41] == states[40:81][::-1] and len(set(states[40:])) == 81
        for n in range(80):
            assert page.inner_text("#step") == states[-1 - n]
            page.keyboard.press("k")
        assert page.inner_text("#step") == states[40]
        differs = page.evaluate(
            """(() => { select(DIFFERENCE); return [...document.querySelectorAll(
            "#step .tree .changed")].map((one) => one.textContent).filter((t) => t.startsWith("≠"))
            .length; })()"""
        )
        assert differs > 0
    with browser.page(path, f"#step={begun}") as page:
        assert page.inner_text("#step") == states[0]
        page.select_option("#type", "Prescription")
        assert page.evaluate("now.shown.every((row, n) => now.before[row] === n)")
        assert (
            page.evaluate(
                "(() => { const b = COUNT - 1 - [...ROW.flags].reverse().findIndex("
                "(f) => f & BESIDE); select(b); return now.row - b; })()"
            )
            == -1
        )
        page.evaluate("select(DIFFERENCE)")
        with page.expect_download() as download:
            page.click("#save-log1")
        prefix = Path(download.value.path())
        assert prefix.read_text().count("\n") > 10 and verdict_of(prefix).verdict == "allowed"
        assert records(prefix)[0] == records(folder / "b" / "2002.ndjson")[0]
