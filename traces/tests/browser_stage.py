"""Pages of ``automcm trace html`` opened in Chromium."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from automcm.links.simulated_radio import Channel
from automcm_simulation.road.simulation import Simulation
from automcm_simulation.road.straight_lane import Straight
from automcm_traces.viewer import page_run
from automcm_traces.viewer.page import html
from automcm_traces.viewer.page_data import load, of_runs

Json = Any


def chromium() -> str:
    """Where Chromium is; empty if nowhere."""
    names = (
        os.environ.get("AUTOMCM_CHROMIUM", ""),
        "chromium",
        "chromium-browser",
        "google-chrome",
    )
    return next((found for name in names if name and (found := shutil.which(name))), "")


class Browser:
    """Opens pages, offline; whatever goes wrong in one is noted."""

    def __init__(self, browser: Any, folder: Path) -> None:
        self._browser, self.folder = browser, folder
        self.problems: list[str] = []

    def write(self, name: str, *logs: Path) -> Path:
        path = self.folder / f"{name}.html"
        path.write_bytes(html(load(logs)))
        return path

    def write_two(self, name: str, a: Sequence[Path], b: Sequence[Path]) -> Path:
        path = self.folder / f"{name}.html"
        path.write_bytes(html(of_runs(page_run.load(a), page_run.load(b))))
        return path

    @contextmanager
    def page(
        self, path: Path, after: str = "", ready: str = "#svg .heads", **how: Any
    ) -> Iterator[Any]:
        size = {"width": 1280, "height": 800}
        context = self._browser.new_context(offline=True, **({"viewport": size} | how))
        page = context.new_page()
        page.on("pageerror", lambda error: self.problems.append(f"{path.name}: {error}"))
        page.on("console", lambda m: self.problems.append(f"{path.name}: {m.type}: {m.text}"))
        page.on("request", self._asked)
        page.goto(f"file://{path}{after}")
        if how.get("java_script_enabled", True):
            try:
                page.wait_for_selector(ready, state="attached")
            except Exception as error:
                raise AssertionError(f"{path.name} does not open: {self.problems}") from error
        yield page
        context.close()

    def _asked(self, request: Any) -> None:
        if not request.url.startswith(("file:", "blob:")):
            self.problems.append(f"a request left the page: {request.url}")


def run(
    folder: Path, until_ms: int, loss: float = 0.2, requests: int = 1, seed: int = 3
) -> list[Path]:
    """Logs of three stations in lane changes."""
    folder.mkdir()
    simulation = Simulation(seed=seed, channel=Channel(loss=loss, duplicate=0.1), logs=folder)
    for station in (1001, 2002, 3003):
        simulation.add(station, Straight())
    for n in range(requests):
        simulation.request(1001 + 1001 * (n % 3), at=500 + n * 13_000)
    simulation.run(until=until_ms)
    return sorted(folder.iterdir())


def two(browser: Browser, folder: Path) -> Path:
    """A page of two runs that part."""
    a, b = (run(folder / name, 9_000, 0.0, seed=seed) for name, seed in (("a", 3), ("b", 5)))
    return browser.write_two("two", a, b)


def boxes(page: Any, selector: str) -> list[dict[str, float]]:
    """Where what is drawn stands: drawn and read at once, because each frame may draw it anew."""
    found: list[dict[str, float]] = page.evaluate(
        "(selector) => { draw(); const all = [...document.querySelectorAll(selector)];"
        " return all.map((one) => one.getBoundingClientRect().toJSON()); }",
        selector,
    )
    return found


def overlapping(boxes: list[list[float]]) -> list[tuple[list[float], list[float]]]:
    """Pairs of boxes (left, top, right, bottom) that share more than a pixel each way."""
    boxes = sorted(boxes, key=lambda box: box[1])
    return [
        (a, b)
        for n, a in enumerate(boxes)
        for b in boxes[n + 1 :]
        if min(a[2], b[2]) - max(a[0], b[0]) > 1 and min(a[3], b[3]) - max(a[1], b[1]) > 1
    ]
