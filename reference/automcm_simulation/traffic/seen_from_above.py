"""All road users over time, for the picture of the traffic from above (``automcm trace html``)."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from automcm_simulation.traffic.mover import STEP_MS

if TYPE_CHECKING:
    from automcm_simulation.traffic.traffic import Traffic

EVERY_MS = 2 * STEP_MS


class Frames:
    """The positions of all road users every EVERY_MS."""

    def __init__(self) -> None:
        self._users: list[dict[str, Any]] = []
        self._frames: list[dict[str, list[int]]] = []

    def add(self, traffic: Traffic) -> None:
        """Take the present positions."""
        if not self._users:
            self._users = [
                {
                    "number": user.number,
                    "equipped": user.equipped,
                    "length_mm": round(1000 * user.length),
                    "width_mm": round(1000 * user.width),
                }
                for user in traffic.users.values()
            ]
        if traffic.clock.now() % EVERY_MS == 0:
            bodies = traffic.mover.bodies()
            self._frames.append(
                {
                    "number": list(bodies),
                    "x_mm": [round(1000 * body.x) for body in bodies.values()],
                    "y_mm": [round(1000 * body.y) for body in bodies.values()],
                    "heading_mrad": [round(1000 * body.heading) for body in bodies.values()],
                }
            )

    def as_json(self) -> str:
        """A file for ``automcm trace html --traffic``; the first frame is at 0 ms."""
        found = {"every_ms": EVERY_MS, "users": self._users, "frames": self._frames}
        return json.dumps(found, separators=(",", ":")) + "\n"
