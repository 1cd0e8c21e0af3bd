"""The page of ``automcm trace html`` in a real browser.

    python traces/tests/browser.py [--screenshots FOLDER] [--picture PAGE]

After ``automcm demo --loss 0.3``, ``--picture runs/demo/page.html`` takes the README's picture.

Needs playwright and Chromium, and for some checks Firefox; what is missing is skipped, and named.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from inspect import isfunction, signature
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

sys.path.append(str(Path(__file__).with_name("viewer")))  # for test_page

import browser_checks
import browser_colour_checks
import browser_firefox
import browser_firefox_checks
import browser_report_checks
import browser_room_checks
import browser_run_checks
import browser_share_checks
import browser_view_checks
from browser_pages import write_all
from browser_stage import Browser, chromium


def _checks(*modules: ModuleType) -> list[Callable[[Any, Path], None]]:
    """The functions of modules that are checks: those that take a browser and a folder."""
    return [
        each
        for module in modules
        for each in vars(module).values()
        if isfunction(each)
        and each.__module__ == module.__name__
        and list(signature(each).parameters) in (["browser", "folder"], ["firefox", "folder"])
        and each.__name__[0] != "_"
    ]


CHECKS = _checks(
    browser_checks,
    browser_view_checks,
    browser_room_checks,
    browser_colour_checks,
    browser_report_checks,
    browser_run_checks,
    browser_share_checks,
)
FIREFOX_CHECKS = _checks(browser_firefox_checks)


def screenshots(browser: Browser, folder: Path) -> None:
    """Pictures for a person to look at."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in write_all(browser.folder).values():
        for width, height in ((1400, 800), (1000, 800), (390, 844)):
            for theme in ("light", "dark"):
                size = {"width": width, "height": height}
                with browser.page(path, viewport=size, color_scheme=theme) as page:
                    page.wait_for_timeout(300)
                    page.screenshot(path=folder / f"{path.stem}-{width}-{theme}.png")


PICTURE = Path(__file__).parents[2] / "docs" / "demo.png"


def picture(browser: Browser, path: Path) -> None:
    """The page of a demonstration, as the README shows it."""
    with browser.page(path.resolve(), viewport={"width": 1400, "height": 640}) as page:
        page.wait_for_timeout(300)
        page.screenshot(path=PICTURE)


class Missing(Exception):
    """What is needed to open pages, and is not on this machine."""


@contextmanager
def _chromium(folder: Path) -> Iterator[Browser]:
    """Chromium. Raises Missing."""
    program = chromium()
    try:
        playwright = importlib.import_module("playwright.sync_api")
    except ImportError:
        raise Missing("playwright") from None
    if not program:
        raise Missing("Chromium")
    with playwright.sync_playwright() as p:
        chrome = p.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield Browser(chrome, folder)
        chrome.close()


@contextmanager
def _firefox(folder: Path) -> Iterator[browser_firefox.Firefox]:
    """Firefox. Raises Missing."""
    program = browser_firefox.firefox()
    if not program:
        raise Missing("Firefox")
    with browser_firefox.started(program, folder) as firefox:
        yield firefox


def _run(
    title: str,
    checks: list[Callable[[Any, Path], None]],
    opened: Callable[[Path], AbstractContextManager[Any]],
    folder: Path,
) -> Counter[str]:
    """How many checks passed, failed and were skipped."""
    counts = Counter[str]()
    folder.mkdir()
    try:
        with opened(folder) as browser:
            for check in checks:
                counts[_passes(check, browser, folder / check.__name__)] += 1
    except Missing as missing:
        print(f"SKIPPED: the page in {title}: {missing} is missing")
        counts["skipped"] += len(checks)
    return counts


def _passes(check: Callable[[Any, Path], None], browser: Any, folder: Path) -> str:
    folder.mkdir()
    browser.problems, browser.folder = [], folder
    name = check.__name__.replace("_", " ")
    try:
        check(browser, folder)
        assert not browser.problems, browser.problems
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[1]
        print(f"FAILED  {name}, line {where.lineno}: {error!r}")
        return "failed"
    print(f"ok      {name}")
    return "passed"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--screenshots", type=Path, help="Only pictures, into this folder.")
    parser.add_argument(
        "--picture", type=Path, help="Only the picture of the README, of this page."
    )
    parser.add_argument("names", nargs="*", help="Only these checks.")
    wanted = parser.parse_args()
    with TemporaryDirectory() as name:
        if wanted.screenshots is not None:
            with _chromium(Path(name)) as browser:
                screenshots(browser, wanted.screenshots)
            return 0
        if wanted.picture is not None:
            with _chromium(Path(name)) as browser:
                picture(browser, wanted.picture)
            return 0
        counts = Counter[str]()
        for title, checks, opened in (
            ("Chromium", CHECKS, _chromium),
            ("Firefox", FIREFOX_CHECKS, _firefox),
        ):
            chosen = [one for one in checks if not wanted.names or one.__name__ in wanted.names]
            if chosen:
                counts += _run(title, chosen, opened, Path(name) / title)
    print(", ".join(f"{counts[what]} {what}" for what in ("passed", "failed", "skipped")))
    return 1 if counts["failed"] else 0


if __name__ == "__main__":
    sys.exit(main())
