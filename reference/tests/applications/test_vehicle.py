"""The error of a measured position."""

import numpy as np

from automcm.applications.vehicle import PositionError


def test_the_error_of_a_position_keeps_its_deviation_and_lasts() -> None:
    error, seen = PositionError(2.0, "a seed"), []
    for _ in range(20_000):
        error.step(PositionError.TIME_S / 10)
        seen.append((error.along, error.across))
    for axis in np.array(seen).T:
        assert abs(axis.std() / error.sigma - 1) < 0.1
        assert abs(np.corrcoef(axis[1:], axis[:-1])[0, 1] - np.exp(-0.1)) < 0.01
