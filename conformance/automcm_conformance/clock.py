"""Timers of a station as the kit keeps them: how long they last, and which of them fires next."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Json = Any
UNKNOWN = -1
"""A time that only the station knows."""
ORDER = ("advertise", "", "decide", "hold", "answer", "cam", "lease", "giveup", "resend")
LAST = ("quarantine", "forget", "backoff")
"""Timers due together fire in this order (section 3); "" is the resend of an Advertisement."""
RANK = {name: n for n, name in enumerate(ORDER + LAST)}


@dataclass(slots=True)
class Running:
    """An armed timer.  ``age`` orders those of one rank: an older message comes first."""

    timer: Json
    deadline: int
    rank: int
    age: int

    @property
    def turn(self) -> tuple[int, int, int]:
        """Timers fire in the order of this."""
        return self.deadline, self.rank, self.age


def rank(name: str, advertises: bool) -> int:
    """The row of section 3 that a timer of this name stands in."""
    return RANK["" if advertises else name]


def natural(parameters: Mapping[str, int]) -> dict[str, int]:
    """How long timers last with these parameters (protocol.md, section 3), in ms."""
    p = parameters
    giveup = (p["t_timeout"] // p["t_resend"] + 1) * p["t_resend"]
    known = p["backoff_min"] == p["backoff_max"]
    return {
        "advertise": giveup,
        "resend": p["t_resend"],
        "decide": p["t_decide"],
        "hold": giveup + p["t_decide"] + 2 * giveup,
        "answer": p["t_decide"] + giveup,
        "cam": p["t_cam_loss"],
        "giveup": giveup,
        "quarantine": max(giveup + 2 * giveup, p["t_cam_loss"] + p["t_resend"] // 2),
        "life": 2 * giveup,
        "backoff": p["backoff_min"] if known else UNKNOWN,
    }


def forgotten_at(natural: Mapping[str, int], joined: int, now: int) -> int:
    """When forget(p) expires if the session of p that was joined then is left now (ADV-8)."""
    return max(joined + natural["advertise"], now) + natural["life"]
