"""KIN-2 and KIN-6 on curves: a lane change's exchange of trajectories, and lateral acceleration."""

from __future__ import annotations

import numpy as np
import pytest

from automcm.encoding.codec import FRAME_BYTES
from automcm.kernels import verify
from automcm.kernels.convert import convert
from automcm.kernels.prescribe import prescribe
from automcm.kernels.thin import POSITION, SPEED, deviation, prescription_bytes, thin
from automcm.kernels.trajectory import Floats, Trajectory, from_message, to_message

Bends = tuple[tuple[float, float], ...]
ROADS: dict[str, Bends] = {
    **{f"arc of {r} m": ((400, 1 / r),) for r in (100, 200, 500, 1450)},
    "straight": ((400, 0),),
    "two curvatures": ((120, 1 / 300), (280, 1 / 120)),
    "S-bend": ((130, 1 / 150), (270, -1 / 150)),
}
"""Length and curvature of each part, in m and 1/m."""
DRIVES = 100
LIMITS = verify.Limits(v_max=130 / 3.6)


def line(bends: Bends, length: float, spacing: float = 5.0) -> Floats:
    """Points of the road ``spacing`` m apart, from Simpson's rule on the heading."""
    fine = np.arange(0, length, 0.01)
    curvature = np.zeros(len(fine))
    since = 0.0
    for part, bend in bends:
        curvature[fine >= since] = bend
        since += part
    heading = np.concatenate([[0.0], np.cumsum(curvature[:-1]) * 0.01])
    steps = 0.01 * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return np.cumsum(steps, axis=0)[:: round(spacing / 0.01)]


def drives(bends: Bends) -> list[tuple[Trajectory, float]]:
    """Plans of 300 m (KIN-1) and the time of the prescription: at random speeds of at most 2.5 m/s²
    to the side."""
    rng = np.random.default_rng(26)
    tightest = max(abs(bend) for _, bend in bends)
    fastest = min(120 / 3.6, np.sqrt(2.5 / max(tightest, 1e-9)))
    found = []
    for _ in range(DRIVES):
        xy = line(bends, 300) + rng.uniform(-1e3, 1e3, 2)
        v = rng.uniform(8, fastest)
        plan = convert(xy, np.full(len(xy), v), xy[0], float(rng.integers(0, 10**6)))
        found.append((plan, float(plan.t[0] + rng.uniform(0, 0.2))))
    return found


def sent(trajectory: Trajectory) -> Trajectory:
    """Thinned and through a message."""
    return from_message(to_message(thin(trajectory)))


@pytest.mark.sweep(2)
@pytest.mark.parametrize("road", ROADS)
def test_what_is_prescribed_on_a_curve_is_agreed(road: str) -> None:
    """The plan is thinned, the prescription is made of that and thinned, and the receiver compares
    it with its plan.  With every fifth point it was refused on arcs of 1,450 m (KIN-2)."""
    agreed = 0
    for plan, now in drives(ROADS[road]):
        intended = sent(plan)
        prescribed = sent(prescribe(intended.since(now), now, hold=2.0, delta_v=4.0, gain=10.0))
        agreed += verify.verify(prescribed, plan, now, LIMITS) == ()
    assert agreed == DRIVES


@pytest.mark.sweep(3)
@pytest.mark.parametrize("road", ROADS)
def test_thinning_keeps_the_bound_if_the_frame_allows_it(road: str) -> None:
    """On an arc of 100 m, 60 points 5 m apart are needed, and the frame has room for fewer."""
    for plan, _ in drives(ROADS[road])[:10]:
        thinned = thin(plan)
        position, speed = deviation(plan, thinned)
        assert prescription_bytes(thinned) <= FRAME_BYTES
        if road == "arc of 100 m":
            assert prescription_bytes(thinned) > FRAME_BYTES - 50
        assert position <= (0.13 if road == "arc of 100 m" else POSITION)
        assert speed <= SPEED


def test_lateral_acceleration_of_an_arc() -> None:
    """v²/R, less what three points a second apart take for it, and what thinning adds."""
    for radius in (50, 100, 500):
        xy = line(((1e3, 1 / radius),), 300, 0.5)
        plan = convert(xy, np.full(len(xy), 12.0), xy[0], 0.0)
        expected = 2 * radius * (1 - np.cos(12.0 / radius))
        assert verify.lateral(plan) == pytest.approx(expected, rel=1e-3)
        assert expected == pytest.approx(12.0**2 / radius, rel=0.01)
        assert np.abs(verify.lateral(thin(plan)) - expected).max() <= 4 * POSITION
        for limit, reasons in ((0.95, (verify.Reason.LATERAL,)), (1.05, ())):
            limits = verify.Limits(lateral=expected * limit)
            assert verify.verify(plan, plan, 0.0, limits) == reasons


def test_standing_and_short_ones_have_no_lateral_acceleration() -> None:
    standing = Trajectory(np.arange(5.0), np.zeros((5, 2)), True)
    assert (verify.lateral(standing) == 0).all()
    assert len(verify.lateral(Trajectory(np.arange(2.0), np.eye(2)))) == 0
