"""The page of ``automcm trace html`` in a real browser.

    python traces/tests/browser.py [--screenshots FOLDER]

Needs playwright and Chromium; without them it is skipped, and says so.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import traceback
from collections.abc import Callable
from inspect import isfunction
from pathlib import Path
from tempfile import TemporaryDirectory

import browser_checks
from browser_stage import Browser, chromium, two
from test_page import CORPUS, FOUR

CHECKS: list[Callable[[Browser, Path], None]] = [
    each
    for each in vars(browser_checks).values()
    if isfunction(each) and each.__module__ == browser_checks.__name__
]


def screenshots(browser: Browser, folder: Path) -> None:
    """Pictures for a person to look at."""
    folder.mkdir(parents=True, exist_ok=True)
    pages = [
        browser.write("good", *FOUR),
        browser.write("bad", CORPUS / "bad/busy_accepted.ndjson"),
        two(browser, folder),
    ]
    for path in pages:
        for width, height in ((1280, 800), (390, 844)):
            for theme in ("light", "dark"):
                size = {"width": width, "height": height}
                with browser.page(path, viewport=size, color_scheme=theme) as page:
                    page.wait_for_timeout(300)
                    name = f"{path.stem}-{width}-{theme}.png"
                    page.screenshot(path=folder / name, full_page=width < 800)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--screenshots", type=Path, help="Only pictures, into this folder.")
    parser.add_argument("names", nargs="*", help="Only these checks.")
    wanted = parser.parse_args()
    program = chromium()
    try:
        playwright = importlib.import_module("playwright.sync_api")
    except ImportError:
        playwright = None
    if playwright is None or not program:
        lacking = "Chromium" if playwright else "playwright"
        print(f"SKIPPED: the page in a browser: {lacking} is missing")
        print(f"0 passed, 0 failed, {len(CHECKS)} skipped")
        return 0
    failed = passed = 0
    with TemporaryDirectory() as name, playwright.sync_playwright() as p:
        chrome = p.chromium.launch(executable_path=program, args=["--no-sandbox"])
        if wanted.screenshots is not None:
            screenshots(Browser(chrome, Path(name)), wanted.screenshots)
            return 0
        for check in CHECKS:
            if wanted.names and check.__name__ not in wanted.names:
                continue
            folder = Path(name) / check.__name__
            folder.mkdir()
            browser = Browser(chrome, folder)
            try:
                check(browser, folder)
                assert not browser.problems, browser.problems
                passed += 1
                print(f"ok      {check.__name__.replace('_', ' ')}")
            except Exception as error:
                failed += 1
                where = traceback.extract_tb(error.__traceback__)[1]
                print(f"FAILED  {check.__name__.replace('_', ' ')}, line {where.lineno}: {error!r}")
        chrome.close()
    print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
