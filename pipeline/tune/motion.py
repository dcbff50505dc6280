"""The odometry's noise (Probabilistic Robotics, Table 5.6), from how a found trajectory differs from the odometry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.geometry import between, wrap_angle
from pipeline.motion.wheels import ON_THE_SPOT, odometry_motion
from pipeline.tune.em import Array

ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4")
WINDOWS = ((0.5, 0.3), (1.0, 0.6), (1.5, 0.9))
"""m, rad: a window ends when the robot has driven or turned so far. Three lengths tell growth from a constant floor."""
IMPOSSIBLE = 0.5
"""m, rad: where hindsight jumps, or the robot was carried, the difference is not the odometry's noise."""
OUTLIER = 5.0
"""Predicted deviations, beyond which the same is so."""
SMALLEST_ERROR = 0.002
"""m, rad: differences below it are rounding."""
ASTRAY = 0.1
"""m: a shorter displacement has no direction that could be trusted."""
SMALLEST = 1e-4
"""A filter whose motion knows no noise cannot follow what it has not seen yet."""
FEWEST = 20
"""Windows, below which the odometry's noise is left as it was."""
ROUNDS = 5


def windows(odometry: Array, poses: Array, scans: NDArray[np.int64], config: Config) -> Array:
    """How a trajectory differs from its odometry, both (n, 3), over windows of the updates ``scans`` (k,).

    Returns (w, 4): error of heading, rad; error along the way driven, m; and, summed over the window's *updates*,
    rot1^2 + rot2^2, rad^2, and trans^2, m^2. Table 5.6 adds noise at every update, of variance alpha1 rot^2 + alpha2
    trans^2 to each of the two turns and alpha3 trans^2 + alpha4 (rot1^2 + rot2^2) to the drive. Variances add up, so
    these sums of squares are the regressors (the square of the sum is not): the alphas belong to this pace of updates.
    """
    moves = [odometry_motion(odometry[a], odometry[b], config) for a, b in pairwise(scans)]
    driven = np.array([m.trans for m in moves])
    turns = np.array([_turns(m.rot1, m.trans, m.rot2) for m in moves]).reshape(-1, 2)
    squares = np.column_stack([np.square(turns).sum(axis=1), np.square(driven)])
    rows: list[list[float]] = []
    for far, angle in WINDOWS:
        begin, path, turned = 0, 0.0, 0.0
        for k in range(len(moves)):
            path, turned = path + abs(driven[k]), turned + abs(float(turns[k].sum()))
            if path < far and turned < angle:
                continue
            a, b = scans[begin], scans[k + 1]
            said, was = between(odometry[a], odometry[b]), between(poses[a], poses[b])
            distance = math.hypot(*said[:2])
            # A turn on the spot has no way of its own: then the way it faced half-way.
            ahead = (
                said[:2] / distance if distance > ASTRAY else np.array([math.cos(said[2] / 2), math.sin(said[2] / 2)])
            )
            errors = [float(wrap_angle(was[2] - said[2])), float(ahead @ (was[:2] - said[:2]))]
            rows.append([*errors, *squares[begin : k + 1].sum(axis=0).tolist()])
            begin, path, turned = k + 1, 0.0, 0.0
    return np.array(rows).reshape(-1, 4)


def fit_motion(found: Sequence[Array], config: Config) -> Config:
    """alpha1 to alpha4 by non-negative least squares of the squared errors in the logs' ``windows``.

    A constant is fitted beside them, the trajectory's own jitter. A square varies the more the larger it is, so each
    is weighted by its predicted value, over a few rounds. With fewer than 20 windows nothing is learned.
    """
    rows = np.concatenate([np.empty((0, 4)), *found])
    if len(rows) < FEWEST:
        return config
    heading, along, turned, driven = rows.T
    # Both turns of an update change the heading: alpha2 counts twice there.
    alpha1, alpha2, _ = variances(heading, np.column_stack([turned, 2.0 * driven]))
    alpha4, alpha3, _ = variances(along, np.column_stack([turned, driven]))
    values = (alpha1, alpha2, alpha3, alpha4)
    return config.model_copy(update={k: max(float(v), SMALLEST) for k, v in zip(ALPHAS, values, strict=True)})


def variances(errors: Array, regressors: Array) -> Array:
    """What each regressor (n, m) contributes to the variance of the errors (n,), and a constant: (m + 1,)."""
    from scipy.optimize import nnls

    possible = np.abs(errors) < IMPOSSIBLE
    squared = np.square(errors[possible])
    design = np.column_stack([regressors[possible], np.ones(len(squared))])
    scale = np.maximum(design.max(axis=0, initial=0.0), 1e-9)  # all near one: better conditioned
    predicted, solution = np.ones(len(squared)), np.zeros(design.shape[1])
    for _ in range(ROUNDS):
        used = squared < OUTLIER**2 * predicted
        weight = used / predicted
        solution = nnls(design / scale * weight[:, None], squared * weight)[0] / scale
        # Never so small that the windows in which nothing happens are all that counts.
        predicted = np.maximum(design @ solution, SMALLEST_ERROR**2)
    return solution


def _turns(rot1: float, trans: float, rot2: float) -> tuple[float, float]:
    """As the motion model counts them: below a centimetre a drive has no direction, and there is one turn."""
    return (rot1, rot2) if abs(trans) >= ON_THE_SPOT else (0.0, rot1 + rot2)
