"""Lesson 5.5: the density of the odometry motion model."""

from __future__ import annotations

import numpy as np

from pipeline.geometry import wrap_angle
from pipeline.lessons.exam import Array, Case, Exact, Returned
from pipeline.lessons.lesson import Lesson, Mistake

CANDIDATES = 12
"""Moves in every case whose density is asked for."""


def motion_model_odometry(moved: Array, poses: Array, before: Array, now: Array, alphas: Array) -> Array:
    """Density of moves, given what the odometry says (Probabilistic Robotics, Table 5.5).

    moved: (n, 3) float64, poses after the move, x (m), y (m), yaw (rad) in the map's frame.
    poses: (n, 3) float64, the poses before it, row by row.
    before, now: (3,) float64, the poses of the odometry before and after, in a frame of its own.
    alphas: (4,) float64. The variance of either turn is alpha1 * turn^2 + alpha2 * drive^2, that of the drive
        is alpha3 * drive^2 + alpha4 * (turn1^2 + turn2^2), where turns and drive are those from the row of
        ``poses`` to the row of ``moved``, which the book writes with a hat; not those of the odometry.
    Returns (n,): the product of the three normal densities, 1/(rad m rad).
    """
    alpha1, alpha2, alpha3, alpha4 = alphas
    trans = np.hypot(now[0] - before[0], now[1] - before[1])
    rot1 = wrap_angle(np.arctan2(now[1] - before[1], now[0] - before[0]) - before[2])
    rot2 = wrap_angle(now[2] - before[2] - rot1)
    dx, dy = (moved[:, :2] - poses[:, :2]).T
    trans_hat = np.hypot(dx, dy)
    rot1_hat = wrap_angle(np.arctan2(dy, dx) - poses[:, 2])
    rot2_hat = wrap_angle(moved[:, 2] - poses[:, 2] - rot1_hat)
    var1 = alpha1 * rot1_hat**2 + alpha2 * trans_hat**2
    var2 = alpha3 * trans_hat**2 + alpha4 * (rot1_hat**2 + rot2_hat**2)
    var3 = alpha1 * rot2_hat**2 + alpha2 * trans_hat**2
    p1 = np.exp(-0.5 * wrap_angle(rot1 - rot1_hat) ** 2 / var1) / np.sqrt(2 * np.pi * var1)
    p2 = np.exp(-0.5 * (trans - trans_hat) ** 2 / var2) / np.sqrt(2 * np.pi * var2)
    p3 = np.exp(-0.5 * wrap_angle(rot2 - rot2_hat) ** 2 / var3) / np.sqrt(2 * np.pi * var3)
    return np.asarray(p1 * p2 * p3)


_ODOMETRY = {
    "a turn, a drive and a turn": ((0.0, 0.0, 0.0), (1.0, 0.6, 0.1), (0.05, 0.012, 0.01, 0.006)),
    "the odometry's yaw passes 180 degrees": ((2.0, 1.0, 3.0), (1.2, 0.9, -2.9), (0.3, 0.02, 0.01, 0.04)),
    "the robot turns by half a turn, within noise": ((0.0, 0.0, 1.0), (-0.5, -0.79, 1.2), (0.02, 0.03, 0.02, 0.001)),
    "noise from turns": ((1.0, -2.0, 0.4), (1.2, -1.1, 0.7), (0.2, 0.001, 0.001, 0.05)),
    "noise from the drive": ((1.0, -2.0, 0.4), (1.8, -1.3, 0.9), (0.001, 0.04, 0.02, 0.0005)),
}


def _case(seed: int, name: str) -> Case:
    """Moves about as the odometry says, off by up to two deviations."""
    before, now, alphas = (np.array(part) for part in _ODOMETRY[name])
    rng = np.random.default_rng([5, 5, seed])
    dx, dy = now[:2] - before[:2]
    trans, rot1 = np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - before[2])
    rot2 = wrap_angle(now[2] - before[2] - rot1)
    variance = np.array(
        [
            alphas[0] * rot1**2 + alphas[1] * trans**2,
            alphas[2] * trans**2 + alphas[3] * (rot1**2 + rot2**2),
            alphas[0] * rot2**2 + alphas[1] * trans**2,
        ]
    )
    off = rng.uniform(-2.0, 2.0, (CANDIDATES, 3)) * np.sqrt(variance)
    poses = np.column_stack([rng.uniform(0.0, 9.0, (CANDIDATES, 2)), rng.uniform(-np.pi, np.pi, CANDIDATES)])
    heading = poses[:, 2] + rot1 + off[:, 0]
    drive = trans + off[:, 1]
    yaw = wrap_angle(heading + rot2 + off[:, 2])
    moved = np.column_stack([poses[:, 0] + drive * np.cos(heading), poses[:, 1] + drive * np.sin(heading), yaw])
    rows = tuple(f"density of the move in row {k}" for k in range(CANDIDATES))
    return Case(name, (moved, poses, before, now, alphas), rows)


LESSON = Lesson(
    name="5.5",
    title="The odometry motion model, as a density",
    source="Probabilistic Robotics, Section 5.4 and Table 5.5",
    task=(
        "How probable is a move from one pose to another, if the odometry says this? The odometry's move is taken "
        "apart into a turn, a drive and a turn, and so is the move that is asked about; their three differences are "
        "normally distributed. Mind that a difference of angles may be off by a whole turn, also the difference of "
        "two turns, and that the variances are those of the move that is asked about."
    ),
    reference=motion_model_odometry,
    exam=Exact(
        motion_model_odometry,
        [Returned("density", "1/(rad m rad)")],
        [_case(seed, name) for seed, name in enumerate(_ODOMETRY)],
    ),
    mistakes=(
        Mistake(
            "the variances are taken from the odometry's move, not from the one that is asked about",
            {
                "var1 = alpha1 * rot1_hat**2 + alpha2 * trans_hat**2": "var1 = alpha1 * rot1**2 + alpha2 * trans**2",
                "var2 = alpha3 * trans_hat**2": "var2 = alpha3 * trans**2",
                "(rot1_hat**2 + rot2_hat**2)": "(rot1**2 + rot2**2)",
                "var3 = alpha1 * rot2_hat**2 + alpha2 * trans_hat**2": "var3 = alpha1 * rot2**2 + alpha2 * trans**2",
            },
        ),
        Mistake(
            "the difference of the two turns is not wrapped into -180 to 180 degrees",
            {"wrap_angle(rot1 - rot1_hat)": "(rot1 - rot1_hat)", "wrap_angle(rot2 - rot2_hat)": "(rot2 - rot2_hat)"},
        ),
        Mistake(
            "the turns of the odometry are not wrapped into -180 to 180 degrees, so that their differences are "
            "not either",
            {
                "wrap_angle(np.arctan2(now": "(np.arctan2(now",
                "rot2 = wrap_angle(now[2] - before[2] - rot1)": "rot2 = now[2] - before[2] - rot1",
                "wrap_angle(rot1 - rot1_hat)": "(rot1 - rot1_hat)",
                "wrap_angle(rot2 - rot2_hat)": "(rot2 - rot2_hat)",
            },
        ),
        Mistake(
            "the turns of the move that is asked about are not wrapped, so that their variance is too large",
            {
                "wrap_angle(np.arctan2(dy, dx) - poses[:, 2])": "np.arctan2(dy, dx) - poses[:, 2]",
                "wrap_angle(moved[:, 2] - poses[:, 2] - rot1_hat)": "moved[:, 2] - poses[:, 2] - rot1_hat",
            },
        ),
        Mistake(
            "variances are taken for deviations",
            {
                "** 2 / var1) / np.sqrt(2 * np.pi * var1)": "** 2 / var1**2) / np.sqrt(2 * np.pi * var1**2)",
                "** 2 / var2) / np.sqrt(2 * np.pi * var2)": "** 2 / var2**2) / np.sqrt(2 * np.pi * var2**2)",
                "** 2 / var3) / np.sqrt(2 * np.pi * var3)": "** 2 / var3**2) / np.sqrt(2 * np.pi * var3**2)",
            },
        ),
        Mistake(
            "the normal densities lack their factor 1 / sqrt(2 pi variance)",
            {
                " / np.sqrt(2 * np.pi * var1)": "",
                " / np.sqrt(2 * np.pi * var2)": "",
                " / np.sqrt(2 * np.pi * var3)": "",
            },
        ),
        Mistake(
            "the factor one half is missing in the exponent",
            {
                "-0.5 * wrap_angle(rot1": "-wrap_angle(rot1",
                "-0.5 * (trans": "-((trans",
                "trans_hat) ** 2 / var2)": "trans_hat) ** 2 / var2))",
                "-0.5 * wrap_angle(rot2": "-wrap_angle(rot2",
            },
        ),
        Mistake(
            "alpha1 and alpha2 are exchanged",
            {"alpha1, alpha2, alpha3, alpha4 = alphas": "alpha2, alpha1, alpha3, alpha4 = alphas"},
        ),
        Mistake(
            "alpha3 and alpha4 are exchanged",
            {"alpha1, alpha2, alpha3, alpha4 = alphas": "alpha1, alpha2, alpha4, alpha3 = alphas"},
        ),
        Mistake("the noise of the drive knows only the first turn", {"(rot1_hat**2 + rot2_hat**2)": "rot1_hat**2"}),
        Mistake(
            "the second turn has the variance of the first",
            {"var3 = alpha1 * rot2_hat**2": "var3 = alpha1 * rot1_hat**2"},
        ),
        Mistake(
            "the old heading of the odometry is not subtracted from the first turn",
            {"now[0] - before[0]) - before[2])": "now[0] - before[0]))"},
        ),
        Mistake(
            "the old heading is not subtracted from the first turn of the move that is asked about",
            {"np.arctan2(dy, dx) - poses[:, 2])": "np.arctan2(dy, dx))"},
        ),
        Mistake(
            "poses before and after the move are exchanged",
            {"dx, dy = (moved": "moved, poses = poses, moved\n    dx, dy = (moved"},
        ),
        Mistake(
            "the odometry's poses before and after are exchanged",
            {
                "alpha1, alpha2, alpha3, alpha4 = alphas": "before, now = now, before\n    alpha1, alpha2, alpha3, "
                "alpha4 = alphas"
            },
        ),
        Mistake(
            "x and y are exchanged in arctan2",
            {
                "np.arctan2(now": "(lambda y, x: np.arctan2(x, y))(now",
                "np.arctan2(dy, dx)": "np.arctan2(dx, dy)",
            },
        ),
        Mistake("the densities are added, not multiplied", {"p1 * p2 * p3": "p1 + p2 + p3"}),
        Mistake("the density of the second turn is left out", {"p1 * p2 * p3": "p1 * p2"}),
        Mistake("the logarithm of the density is returned", {"p1 * p2 * p3": "np.log(p1 * p2 * p3)"}),
        Mistake(
            "the old heading of the odometry is added to the first turn, and not subtracted",
            {"now[0] - before[0]) - before[2]": "now[0] - before[0]) + before[2]"},
        ),
        Mistake(
            "the first turn is added to the second, and not subtracted, in the odometry's move",
            {"before[2] - rot1)": "before[2] + rot1)"},
        ),
        Mistake(
            "the first turn is added to the second, and not subtracted, in the move that is asked about",
            {"poses[:, 2] - rot1_hat)": "poses[:, 2] + rot1_hat)"},
        ),
        Mistake("the density of the first turn is left out", {"p1 * p2 * p3": "p2 * p3"}),
        Mistake("the density of the drive is left out", {"p1 * p2 * p3": "p1 * p3"}),
        Mistake(
            "the exponents have the wrong sign",
            {
                "np.exp(-0.5 * wrap_angle(rot1": "np.exp(0.5 * wrap_angle(rot1",
                "np.exp(-0.5 * (trans": "np.exp(0.5 * (trans",
                "np.exp(-0.5 * wrap_angle(rot2": "np.exp(0.5 * wrap_angle(rot2",
            },
        ),
        Mistake(
            "the square root of 2 pi variance is not taken",
            {
                "np.sqrt(2 * np.pi * var1)": "(2 * np.pi * var1)",
                "np.sqrt(2 * np.pi * var2)": "(2 * np.pi * var2)",
                "np.sqrt(2 * np.pi * var3)": "(2 * np.pi * var3)",
            },
        ),
    ),
)
