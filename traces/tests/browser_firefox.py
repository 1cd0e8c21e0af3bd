"""Pages of ``automcm trace html`` opened in Firefox, by WebDriver BiDi."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

STARTS_S = 120
"""How long Firefox may take to start on a busy machine."""


def firefox() -> str:
    """Where Firefox is; empty if nowhere."""
    names = (os.environ.get("AUTOMCM_FIREFOX", ""), "firefox", "firefox-esr")
    return next((found for name in names if name and (found := shutil.which(name))), "")


class Firefox:
    """One tab; errors that a page reports are noted."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket, self._last = socket, 0
        self.problems: list[str] = []
        self.ask("session.new", capabilities={})
        self._tab = self.ask("browsingContext.getTree")["contexts"][0]["context"]
        self.ask("session.subscribe", events=["log.entryAdded"])

    def ask(self, method: str, **parameters: Any) -> Any:
        """Send a command and return its result."""
        self._last += 1
        self._socket.send(json.dumps({"id": self._last, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=STARTS_S))
            if answer.get("method") == "log.entryAdded":
                self.problems.append(f"{answer['params']['level']}: {answer['params']['text']}")
            elif answer.get("id") == self._last:
                assert answer["type"] == "success", answer
                return answer["result"]

    def open(self, path: Path, width: int = 1280, height: int = 800) -> None:
        """In a new tab: a page that puts its view into its address may end another navigation."""
        old, self._tab = self._tab, self.ask("browsingContext.create", type="tab")["context"]
        self.ask("browsingContext.close", context=old)
        size = {"width": width, "height": height}
        self.ask("browsingContext.setViewport", context=self._tab, viewport=size)
        address = f"file://{path}"
        self.ask("browsingContext.navigate", context=self._tab, url=address, wait="complete")
        self.evaluate("new Promise((done) => requestAnimationFrame(() => done(draw())))")

    def evaluate(self, expression: str) -> Any:
        """The value of an expression in the page."""
        found = self.ask(
            "script.evaluate",
            expression=f"Promise.resolve({expression}).then((v) => JSON.stringify(v ?? null))",
            target={"context": self._tab},
            awaitPromise=True,
        )
        assert found["type"] == "success", found
        return json.loads(found["result"]["value"])

    def press(self, keys: str, shift: bool = False) -> None:
        """Press keys one after the other."""
        actions = [{"type": way, "value": k} for k in keys for way in ("keyDown", "keyUp")]
        if shift:
            held = {"value": "\ue008"}
            actions = [{"type": "keyDown"} | held, *actions, {"type": "keyUp"} | held]
        self._act({"type": "key", "id": "keys", "actions": actions})

    def drag(self, *places: tuple[float, float]) -> None:
        """Press the pointer at the first place, and let go of it at the last."""
        moves = [{"type": "pointerMove", "x": round(x), "y": round(y)} for x, y in places]
        down, up = ({"type": f"pointer{way}", "button": 0} for way in ("Down", "Up"))
        self._act({"type": "pointer", "id": "mouse", "actions": [moves[0], down, *moves[1:], up]})

    def _act(self, source: dict[str, Any]) -> None:
        self.ask("input.performActions", context=self._tab, actions=[source])

    def screenshot(self, path: Path) -> None:
        data = self.ask("browsingContext.captureScreenshot", context=self._tab)["data"]
        path.write_bytes(base64.b64decode(data))


@contextmanager
def started(program: str, folder: Path) -> Iterator[Firefox]:
    """Firefox with a profile of its own, which ends with the block."""
    (folder / "profile").mkdir()
    command = [program, "--headless", "--no-remote", "--profile", str(folder / "profile")]
    process = subprocess.Popen(
        [*command, "--remote-debugging-port", "0"],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stderr is not None
        found = (re.search(r"listening on (ws://\S+)", line) for line in process.stderr)
        address = next(match[1] for match in found if match)
        with connect(f"{address}/session", max_size=None) as socket:
            yield Firefox(socket)
    finally:
        process.terminate()
        process.wait()
