"""The parameters of a station, the derived times, and the firing order of timers (docs/protocol.md,
section 3).

The formulas are the same in milliseconds and in the ticks of TimedSystem.tla. They serve a station,
which knows all parameters; the kit, which sets them; and a log, whose header may lack some.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Final, Literal

Unit = Literal["ms", "percent", "count"]
CLOCK_MS: Final = 100
"""The clocks of two stations are in step if they differ by no more (APP-6)."""
Known = Mapping[str, int]
"""Known parameters and derived times by name."""
Formula = Callable[[Known], int]


class ParameterError(ValueError):
    """A parameter that cannot work; the text names it."""


def _given(default: int, unit: Unit, meaning: str, least: int = 0, most: int = 2**53 - 1) -> int:
    about = {"unit": unit, "meaning": meaning, "least": least, "most": most}
    row: int = field(default=default, metadata=about)
    return row


def _derived(formula: Formula) -> int:
    row: int = field(init=False, metadata={"unit": "ms", "formula": formula})
    return row


@dataclass(frozen=True, kw_only=True, slots=True)
class Parameters:
    """The configuration of a station, and the times derived from it.

    Defaults are those of Table I of the paper where it has them. Raises ParameterError for a value
    that is not an integer or out of bounds, for an ``outbox_limit`` that is too small (MEM-1), and
    for a ``backoff_max`` below ``backoff_min``.
    """

    t_timeout: int = _given(2000, "ms", "from the first to the last sending of a message, at most")
    t_resend: int = _given(100, "ms", "from one sending of a message to the next", least=1)
    t_giveup: int = _derived(lambda p: (p["t_timeout"] // p["t_resend"] + 1) * p["t_resend"])
    t_advertise: int = _derived(lambda p: p["t_giveup"])
    t_decide: int = _given(500, "ms", "an application has to choose or to verify")
    t_hold: int = _derived(lambda p: p["t_advertise"] + p["t_decide"] + 2 * p["t_giveup"])
    t_life: int = _derived(lambda p: 2 * p["t_giveup"])
    t_cam_loss: int = _given(
        1500, "ms", "without a CAM of the peer; longer than the longest legal CAM interval", 1001
    )
    t_cam: int = _given(100, "ms", "the CAM interval", least=1, most=1000)
    backoff_min: int = _given(500, "ms", "the shortest back-off")
    backoff_max: int = _given(2000, "ms", "the longest back-off")
    clock_drift: int = _given(1, "percent", "by which two clocks may differ; 0: not at all", 0, 99)
    max_rounds: int = _given(3, "count", "proposals in a session", least=1)
    max_participants: int = _given(32, "count", "stations recorded and withdrawn", least=1)
    outbox_limit: int = _given(64, "count", "messages being sent")
    memory_limit: int = _given(64, "count", "prescribers remembered", least=1)

    def __post_init__(self) -> None:
        known: dict[str, int] = {}
        for row in fields(self):
            about = row.metadata
            if not row.init:
                object.__setattr__(self, row.name, about["formula"](known))
            known[row.name] = value = getattr(self, row.name)
            if type(value) is not int:
                raise ParameterError(f"{row.name}: must be an integer, not {value!r}")
            if row.init and not about["least"] <= value <= about["most"]:
                bound = f"at most {about['most']}" if value > about["most"] else ""
                bound = bound or f"at least {about['least']}"
                text = f"{row.name}: must be {bound}, not {value} ({about['unit']}"
                raise ParameterError(f"{text}: {about['meaning']})")
        if self.outbox_limit <= max(self.max_participants, self.max_rounds):
            raise ParameterError(
                "outbox_limit: must exceed max_participants and max_rounds (MEM-1)"
            )
        if self.backoff_max < self.backoff_min:
            raise ParameterError("backoff_max: must be at least backoff_min")

    @property
    def known(self) -> dict[str, int]:
        """All parameters and derived times by name."""
        return {name: getattr(self, name) for name in UNITS}


DEFAULTS: Final[dict[str, int]] = {
    row.name: row.default for row in fields(Parameters) if isinstance(row.default, int)
}
DERIVED: Final[dict[str, Formula]] = {
    row.name: row.metadata["formula"] for row in fields(Parameters) if not row.init
}
UNITS: Final[dict[str, Unit]] = {row.name: row.metadata["unit"] for row in fields(Parameters)}
LIMITS: Final = {n: n.title().replace("_", "") for n, unit in UNITS.items() if unit == "count"}
"""The parameters that the rules use, with the constants of Station.tla, in its order."""
IN_HEADER: Final = tuple(n for n in UNITS if n not in ("t_cam", "backoff_min", "backoff_max"))
"""The parameters that the header of a log may contain."""


@dataclass(frozen=True, slots=True)
class TimerRow:
    """One kind of timer."""

    rank: int
    """Of timers due at the same time, the one with the lowest rank fires first; of equal rank, the
    oldest."""
    lasts: Callable[[Known], int | None] | None = None
    """The duration. None for a lease and for a forget timer, which depend on the session (see
    below). The duration of a back-off is known only if its minimum and maximum are equal."""


TIMERS: Final = {
    "advertise": TimerRow(1, lambda p: p["t_advertise"]),
    "decide": TimerRow(3, lambda p: p["t_decide"]),
    "hold": TimerRow(4, lambda p: p["t_hold"]),
    "answer": TimerRow(5, lambda p: p["t_decide"] + p["t_giveup"]),
    "cam": TimerRow(6, lambda p: p["t_cam_loss"]),
    "lease": TimerRow(7),
    "giveup": TimerRow(8, lambda p: p["t_giveup"]),
    "resend": TimerRow(9, lambda p: p["t_resend"]),
    "quarantine": TimerRow(
        10,
        lambda p: max(p["t_advertise"] + p["t_life"], p["t_cam_loss"] + longest_delay(p)),
    ),
    "forget": TimerRow(11),
    "backoff": TimerRow(
        12, lambda p: p["backoff_min"] if p["backoff_min"] == p["backoff_max"] else None
    ),
}
ADVERTISED_RANK = 2
"""The rank of an Advertisement's resend timer."""


def rank(name: str, advertises: bool) -> int:
    """The rank of a timer; ``advertises`` means that it belongs to an Advertisement."""
    return ADVERTISED_RANK if advertises else TIMERS[name].rank


def longest_delay(p: Known) -> int:
    """D, the maximum delay of a copy."""
    return p["t_resend"] // 2


def in_header(p: Known) -> dict[str, int]:
    """Those of these parameters that the header of a log may contain."""
    return {name: value for name, value in p.items() if name in IN_HEADER}


def derived(p: Known) -> dict[str, int]:
    """The derived times; all parameters must be known."""
    known = dict(p)
    for name, formula in DERIVED.items():
        known[name] = formula(known)
    return {name: known[name] for name in DERIVED}


def durations(p: Known) -> dict[str, int | None]:
    """The duration of each timer by name; None if it is unknown or has no formula."""
    return {name: _lasts(row, p) for name, row in TIMERS.items()}


def _lasts(row: TimerRow, p: Known) -> int | None:
    try:
        return None if row.lasts is None else row.lasts(p)
    except KeyError:
        return None


def lease_lasts(clock_drift: int, role: str, lease_ms: int) -> int:
    """The duration of the lease timer in ms, for the lease of a Prescription (ACT-4).

    The prescriber's is shorter by the maximum clock drift during the lease, and by 1 ms for
    rounding.
    """
    if role != "prescriber" or clock_drift == 0:
        return lease_ms
    lost = -(-lease_ms * clock_drift // 100)
    return max(1, lease_ms - lost - 1)


def cam_lead(clock_drift: int, t_resend: int, elapsed_ms: int) -> int:
    """By how many ms, at most, the generation time of a CAM may exceed that of the first one that
    counted, ``elapsed_ms`` after that one was received (ACT-5)."""
    return elapsed_ms - (-elapsed_ms * clock_drift // 100) + 4 * t_resend


def forgotten_at(p: Known, joined: int, now: int) -> int:
    """The time at which forget(p) expires, if the session joined at ``joined`` ends at ``now``
    (ADV-8)."""
    return max(joined + p["t_advertise"] + p["t_life"], now + p["t_life"])


def longest_session(p: Known, role: str, lease: int) -> int:
    """The maximum duration of a session (T-1), where ``lease`` is the longest of its leases."""
    decide, rounds = p["t_decide"], p["max_rounds"]
    if role == "prescriber":
        one = min(lease, 2 * p["t_giveup"] + decide)
        return p["t_advertise"] + decide + (rounds - 1) * (one + decide) + lease
    return p["t_giveup"] + rounds * (p["t_hold"] + decide) + max(lease, p["t_hold"])
