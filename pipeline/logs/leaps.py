"""Steps of odometry that no robot makes, for it has been restarted or is wrong: the one limit for all who look."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FASTEST, SPINNING = 5.0, 6.0
"""m/s, rad/s: no robot is faster."""
LEAP, LEAP_TURN = 0.5, 0.5
"""m, rad: by how much more than the fastest robot's drive an odometry may be off its last pose, until it has leapt."""


def leapt(step: NDArray[np.float64], seconds: ArrayLike) -> NDArray[np.bool_]:
    """Whether no robot makes these steps (..., 3) m, m, rad, turns from -pi to pi, in so many ``seconds`` (...)."""
    far, turn = np.hypot(step[..., 0], step[..., 1]), np.abs(step[..., 2])
    seconds = np.asarray(seconds)
    return np.asarray((far > FASTEST * seconds + LEAP) | (turn > SPINNING * seconds + LEAP_TURN))
