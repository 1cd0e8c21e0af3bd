"""The exact bounds on a clock's offset (APP-6), in integers; independent of the reference."""

from __future__ import annotations

from typing import Any

from automcm_maintenance.exact_vectors.exact_geometry import Refused

Json = Any


def clock(given: Json) -> Json:
    """APP-6: by how many ms the clock of the sender of these CAMs is ahead, and is it in step?"""
    now, delay, drift = given["now"], given["delay"], given["drift"]
    cams = given["cams"]
    least: int | None = None
    greatest: int | None = None
    for generated, received in cams:
        age = now - received
        if age <= 2000:
            low = generated - received - rounded_up(age * drift)
            least = low if least is None else max(least, low)
    if least is None:
        raise Refused("cams", None, "must have one of the last 2 s")
    for generated, received in cams:
        age = now - received
        high = generated - received + delay + rounded_up(age * drift)
        late = high < least
        if age <= 2000 and not late:
            greatest = high if greatest is None else min(greatest, high)
    assert greatest is not None
    in_step = least <= 100 and greatest >= -100
    return {"least": least, "greatest": greatest, "in_step": in_step}


def rounded_up(hundredths: int) -> int:
    """The least integer that is not below a number of hundredths."""
    return (hundredths + 99) // 100
