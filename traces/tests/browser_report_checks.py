"""The kit's report in a browser: a card for each cause, links, what passed folded, copying."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

from browser_stage import Browser

from automcm_conformance.report import report as report_
from automcm_spec.vocabulary.rules import operators

sys.path.append(str(Path(__file__).parents[2] / "conformance" / "tests"))  # for report_stage

from report_stage import case, failure, run

ACTS = "AMCM/PRE/ACT/TI-01"
TEXTS = "all => all.map((one) => one.textContent)"


def _report(folder: Path) -> Path:
    failed = replace(
        failure(),
        line=operators()["OnForeignPrescription"][0],
        allowed=["Cancel to 2 cam_loss; STANDALONE"],
        came=["Cancel to 2 lease_expired; STANDALONE"],
        command="automcm conform replay x.json -- ./station",
    )
    passed = [case(f"AMCM/RCV/NEG/BI-{n:02}") for n in range(1, 60)]
    bad = case(ACTS, "FAIL", failures=[failed])
    path = folder / "report.html"
    path.write_text(report_.html([run(*passed, bad)]))
    return path


def _open(browser: Browser, path: Path, **how: Any) -> Any:
    return browser.page(path, ready=".cause", **how)


def a_cause_is_a_card_with_all_that_matters(browser: Browser, folder: Path) -> None:
    with _open(browser, _report(folder), viewport={"width": 1400, "height": 900}) as page:
        (card,) = page.eval_on_selector_all("article.cause", TEXTS)
        words = ("given", "when", "then", "Expected", "Received", "bug text", "cost text")
        assert all(word in card for word in words)
        assert page.eval_on_selector_all(".cause mark", TEXTS) == ["cam_loss", "lease_expired"]
        page.evaluate("navigator.clipboard.writeText = (words) => { window.copied = words; }")
        page.click(".cause .copy")
        assert page.evaluate("window.copied") == "automcm conform replay x.json -- ./station"


def the_report_has_contents_and_links_and_folds_what_passed(browser: Browser, folder: Path) -> None:
    with _open(browser, _report(folder), viewport={"width": 1400, "height": 900}) as page:
        side, main = (page.locator(part).bounding_box() for part in ("nav", "main"))
        assert side["x"] + side["width"] <= main["x"]
        targets = page.eval_on_selector_all(
            "a[href^='#']", "all => all.map((one) => one.getAttribute('href').slice(1))"
        )
        missing = [one for one in targets if not page.locator(f"[id='{one}']").count()]
        assert {"rule-NEG-4", "cause-1-1"} <= set(targets) and not missing, missing
        assert any(target.startswith("tla-") for target in targets)
        assert not page.is_visible(".passed tbody tr")
        assert page.evaluate("document.documentElement.scrollHeight") < 5000
        page.select_option("#verdict", "PASS")
        assert page.locator(".passed tbody tr:visible").count() == 59
