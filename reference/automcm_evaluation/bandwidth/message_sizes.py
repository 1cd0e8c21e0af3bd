"""The size of messages in each codec, and the messages that fit in one frame (KIN-2).

The table is in docs/messages.md.
"""

from __future__ import annotations

from bisect import bisect_left
from typing import Any, NamedTuple

from automcm.encoding.codec import FRAME_BYTES, NAMES, Codec, codec
from automcm_spec.vocabulary.messages import (
    Acceptance,
    Ack,
    Advertisement,
    Cam,
    Cancel,
    Fin,
    Intention,
    Message,
    MessageError,
    MessageId,
    Prescription,
    Trajectory,
)

POINTS = (1, 10, 52, 260)
"""52 is the paper's case: 260 m, a point every 5 m.  260 is the number before thinning to 1/5."""

_CAR, _OTHER, _NOW = 3_000_000_001, 3_000_000_002, 1_800_000_000_000


class MessageSize(NamedTuple):
    """The size of one message, in bytes by codec.  ``points`` is 0 without a trajectory."""

    type: str
    points: int
    bytes: dict[str, int]


def trajectory(points: int) -> Trajectory:
    """Points 5 m apart at 30 km/h, oblique to the axes, starting a kilometre from the origin."""
    places = ((600 * i, 1_000_000 + 4000 * i, 500_000 + 3000 * i) for i in range(points))
    return Trajectory(t0=_NOW, points=tuple(places))


def carrying(driven: Trajectory) -> list[Message]:
    """One message of each type with a trajectory, with large station ids."""
    session, about = (_CAR, 12), "lane_change"
    to: dict[str, Any] = {"src": _CAR, "dst": _OTHER, "session": session, "seq": 2, "proposal": 1}
    back = to | {"src": _OTHER, "dst": _CAR}
    return [
        Advertisement(src=_CAR, session=session, seq=1, scenario=about, details={}, planned=driven),
        Intention(src=_OTHER, dst=_CAR, session=session, seq=1, planned=driven),
        Prescription(**to, prescribed=driven, hold_ms=2000, lease_ms=60_000),
        Acceptance(**back, accepted=True, selected=driven),
    ]


def plain() -> list[Message | Cam]:
    """One message of each type without a trajectory."""
    session = (_CAR, 12)
    no = {"src": _OTHER, "dst": _CAR, "session": session, "seq": 2, "proposal": 1}
    return [
        Advertisement(src=_CAR, session=session, seq=1, scenario="lane_change", details={}),
        Acceptance.model_validate(no | {"accepted": False, "reason": "unsafe"}),
        Fin(src=_CAR, dst=_OTHER, session=session, seq=3),
        Cancel(src=_CAR, dst=_OTHER, session=session, seq=3, reason="not_selected"),
        Ack(src=_OTHER, dst=_CAR, session=session, of=MessageId(type="Fin", seq=3)),
        Cam(
            src=_CAR,
            generation_ms=_NOW,
            x_mm=1_000_000,
            y_mm=500_000,
            heading_mrad=644,
            speed_mm_s=8333,
            marks=(session,),
        ),
    ]


def measure() -> list[MessageSize]:
    """The size of each type in each codec; with a trajectory, for each number of points.

    Raises CodecError if the extra ``automcm[asn1]`` is not installed.
    """
    messages: list[tuple[int, Message | Cam]] = [(0, message) for message in plain()]
    messages += [(n, message) for n in POINTS for message in carrying(trajectory(n))]
    return [
        MessageSize(m.type, n, {name: len(codec(name).encode(m)) for name in NAMES})
        for n, m in messages
    ]


def most_points(used: Codec, budget: int = FRAME_BYTES) -> int:
    """The maximum number of points of a Prescription within the budget in bytes (KIN-2)."""

    def too_large(points: int) -> bool:
        try:
            return len(used.encode(carrying(trajectory(points))[2])) > budget
        except MessageError:  # for a datagram
            return True

    return bisect_left(range(1, budget + 1), True, key=too_large)


def table() -> str:
    """The measured sizes as Markdown."""
    lines = ["| message | points | JSON, bytes | UPER, bytes |", "|---|---:|---:|---:|"]
    for type_, points, sizes in measure():
        cells = [f"{size:,}" if size <= FRAME_BYTES else f"**{size:,}**" for size in sizes.values()]
        lines.append(f"| {type_} | {points or '-'} | {' | '.join(cells)} |")
    most = ", ".join(f"{most_points(codec(name))} in {name.upper()}" for name in NAMES)
    fit = f"Points with which a Prescription fits one frame of {FRAME_BYTES} bytes: {most}."
    return "\n".join([*lines, "", fit])
