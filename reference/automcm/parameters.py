"""Parameters (docs/protocol.md, section 3).  All durations in integer milliseconds.

No parameter but the limits enters the logic: the rules arm named timers, and ``Parameters``
says how long each lasts.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields

from automcm.state import Timer


class ParameterError(ValueError):
    """A parameter that cannot work; the text names it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Parameters:
    """What a station is configured with.  Defaults: Table I of the paper where it has them.

    ``clock_drift``: how many percent the clocks of two stations may differ; 0: they run alike.

    Raises ParameterError for a negative duration, a limit below 1, a ``clock_drift`` of 100 or
    more, or a ``t_cam_loss`` that a legal CAM interval (1 s) alone would exceed.
    """

    t_timeout: int = 2000
    t_resend: int = 100
    t_decide: int = 500
    t_cam_loss: int = 1500
    t_cam: int = 100
    backoff_min: int = 500
    backoff_max: int = 2000
    max_rounds: int = 3
    max_participants: int = 32
    outbox_limit: int = 64
    memory_limit: int = 64
    clock_drift: int = 1

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if type(value) is not int:
                raise ParameterError(f"{field.name}: an integer is needed, not {value!r}")
            if value < 0:
                raise ParameterError(f"{field.name}: {value} is negative")
        for name in ("t_resend", "t_cam", "max_rounds", "max_participants", "memory_limit"):
            if getattr(self, name) < 1:
                raise ParameterError(f"{name}: must be at least 1")
        if self.t_cam_loss <= 1000:
            raise ParameterError("t_cam_loss: must exceed the longest legal CAM interval, 1000 ms")
        if self.t_cam > 1000:
            raise ParameterError("t_cam: the longest legal CAM interval is 1000 ms")
        if self.outbox_limit <= max(self.max_participants, self.max_rounds):
            raise ParameterError(
                "outbox_limit: must exceed max_participants and max_rounds (MEM-1)"
            )
        if self.clock_drift > 99:
            raise ParameterError("clock_drift: must be below 100 percent")
        if self.backoff_max < self.backoff_min:
            raise ParameterError("backoff_max: below backoff_min")

    @property
    def t_giveup(self) -> int:
        """Transmissions at 0, t_resend, …, t_timeout; given up one t_resend after the last."""
        return (self.t_timeout // self.t_resend + 1) * self.t_resend

    @property
    def t_advertise(self) -> int:
        """How long the window for Intentions is open, ms."""
        return self.t_giveup

    @property
    def t_hold(self) -> int:
        """How long a receiver waits for a Prescription, ms."""
        return self.t_advertise + self.t_decide + 2 * self.t_giveup

    @property
    def t_life(self) -> int:
        """After so long no copy of a message is under way any more, ms."""
        return 2 * self.t_giveup

    def lease(self, role: str, lease_ms: int) -> int:
        """How long the lease timer lasts, ms, with the lease of a Prescription (ACT-4).

        The prescriber's is shorter by what its clock may lose meanwhile, and 1 ms for rounding.
        """
        if role != "prescriber" or self.clock_drift == 0:
            return lease_ms
        lost = -(-lease_ms * self.clock_drift // 100)
        return max(1, lease_ms - lost - 1)

    def duration(self, timer: Timer) -> int:
        """How long the timer lasts, in ms.

        Not for ``lease`` (above), ``backoff`` (random) and ``forget`` (counts from joining as
        well); the station knows those.
        """
        match timer.name:
            case "advertise":
                return self.t_advertise
            case "resend":
                return self.t_resend
            case "giveup":
                return self.t_giveup
            case "decide":
                return self.t_decide
            case "hold":
                return self.t_hold
            case "answer":
                return self.t_decide + self.t_giveup
            case "cam":
                return self.t_cam_loss
            case "quarantine":
                acts_on = self.t_cam_loss + self.t_resend // 2  # ACT-6
                return max(self.t_advertise + self.t_life, acts_on)
        raise ValueError(f"no fixed duration: {timer.name}")

    def as_dict(self) -> dict[str, int]:
        """All of them, the derived ones included, for a log's header."""
        derived = {name: getattr(self, name) for name in ("t_giveup", "t_advertise", "t_hold")}
        return asdict(self) | derived | {"t_life": self.t_life}
