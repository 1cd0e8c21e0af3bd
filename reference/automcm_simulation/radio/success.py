"""KIN-7: the probability that an exchange succeeds (VI-C, Eq. 2)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from automcm.kernels.trajectory import Floats, TrajectoryError, number, whole

EXCHANGES = 3
"""Number of consecutive exchanges of a session: Intention, Prescription, Acceptance."""


def sendings(t_timeout: float, t_resend: float) -> int:
    """N = 1 + floor(t_timeout / t_resend), both in one unit.

    Open in the paper: Eq. 2's N = t_timeout/t_resend is 0 for t_timeout = 0, where Fig. 9 shows
    successes; here the first sending counts.  A quotient within 1e-9 (relative) below a whole
    number is that number: 0.3 / 0.1 is 3.  Raises TrajectoryError for t_timeout < 0 or
    t_resend <= 0.
    """
    timeout, resend = number("t_timeout", t_timeout, 0), number("t_resend", t_resend, 0, above=True)
    quotient = timeout / resend
    if not math.isfinite(quotient):
        raise TrajectoryError("t_resend", f"{t_resend} is too small")
    return 1 + math.floor(quotient * (1 + 1e-9))


def message(loss: ArrayLike, n: int) -> Floats:
    """1 - λ^N: at least one of N copies arrives (KIN-7; Eq. 2 with the N of ``sendings``).

    ``loss``: λ, of each copy independently, 0 to 1, any shape; the result has the same.
    """
    return np.asarray(1 - _loss(loss) ** whole("n", n, 1))


def exchange(loss: ArrayLike, n: int) -> Floats:
    """1 - (1 - q)^N with q = (1 - λ)²: of N copies, one arrives and its answer comes back (KIN-7).

    Open in the paper: Eq. 2 covers one direction; an exchange needs its answer, too.
    """
    q = (1 - _loss(loss)) ** 2
    return np.asarray(1 - (1 - q) ** whole("n", n, 1))


def session(loss: ArrayLike, n: int) -> Floats:
    """exchange³ (KIN-7).

    Open in the paper: "proportional to p".  Three exchanges follow one another; that they lose
    independently, and nothing else fails, is the model's choice.
    """
    return np.asarray(exchange(loss, n) ** EXCHANGES)


def _loss(loss: ArrayLike) -> Floats:
    try:
        made = np.array(loss, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TrajectoryError("loss", f"must be an array of numbers: {error}") from None
    good = (made >= 0) & (made <= 1)
    if not good.all():
        where = tuple(int(i) for i in np.argwhere(~good)[0])
        raise TrajectoryError("loss", f"must be between 0 and 1, not {made[where]}", *where)
    return made
