"""Lesson 7.2: the measurement update of EKF localization with landmarks."""

from __future__ import annotations

import numpy as np

from pipeline.geometry import wrap_angle
from pipeline.lessons.exam import Array, Case, Exact, Returned
from pipeline.lessons.lesson import Lesson, Mistake


def ekf_update(mean: Array, covariance: Array, z: Array, landmark: Array, deviations: Array) -> tuple[Array, Array]:
    """Correct a Gaussian belief by one landmark that is known (Probabilistic Robotics, Table 7.2, lines 9 to 18).

    mean: (3,) float64, the robot's pose as believed, x (m), y (m), yaw (rad).
    covariance: (3, 3) float64, of x, y and yaw.
    z: (2,) float64, what the robot measured: how far the landmark is, m, and in which direction, rad,
        counter-clockwise from where the robot looks.
    landmark: (2,) float64, where it is in the map, x (m), y (m).
    deviations: (2,) float64, standard deviations of range (m) and direction (rad).
    Returns the new mean (3,), whose yaw may differ by whole turns, and the new covariance (3, 3).
    """
    dx, dy = landmark - mean[:2]
    q = dx**2 + dy**2
    r = np.sqrt(q)
    z_hat = np.array([r, np.arctan2(dy, dx) - mean[2]])
    h = np.array([[-dx / r, -dy / r, 0.0], [dy / q, -dx / q, -1.0]])
    s = h @ covariance @ h.T + np.diag(deviations**2)
    gain = covariance @ h.T @ np.linalg.inv(s)
    innovation = z - z_hat
    innovation[1] = wrap_angle(innovation[1])
    return mean + gain @ innovation, (np.eye(3) - gain @ h) @ covariance


def _case(group: str, seed: int, pose: tuple[float, float, float], landmark: tuple[float, float]) -> Case:
    """A belief that is off by about its deviation, and what the robot measures."""
    rng = np.random.default_rng([7, 2, seed])
    part = rng.normal(0.0, 1.0, (3, 3)) * np.array([[0.5], [0.35], [0.15]])
    covariance = part @ part.T + np.diag([0.02, 0.02, 0.004])
    deviations = np.array([0.2, 0.07])
    mean = np.array(pose) + np.linalg.cholesky(covariance) @ rng.normal(0.0, 0.7, 3)
    dx, dy = np.array(landmark) - pose[:2]
    z = np.array([np.hypot(dx, dy), wrap_angle(np.arctan2(dy, dx) - pose[2])]) + rng.normal(0.0, 0.7, 2) * deviations
    z[1] = wrap_angle(z[1])
    return Case(group, (mean, covariance, z, np.array(landmark), deviations))


LESSON = Lesson(
    name="7.2",
    title="EKF localization: correcting by a landmark",
    source="Probabilistic Robotics, Section 7.4 and Table 7.2, lines 9 to 18",
    task=(
        "The belief is a single Gaussian. A landmark whose place is known is seen at some range and in some "
        "direction; from the mean it should be seen at another one. The difference moves the mean, by as much as "
        "the two covariances say, and makes the covariance smaller. What has to be worked out is the Jacobian: how "
        "range and direction change with x, y and yaw. Mind that the difference of two directions may be off by a "
        "whole turn."
    ),
    reference=ekf_update,
    exam=Exact(
        ekf_update,
        [Returned("mean", "(m, m, rad)", angles=(2,)), Returned("covariance")],
        [
            _case("the landmark is ahead", 0, (1.0, 2.0, 0.3), (5.0, 3.5)),
            _case("the landmark is on the left", 1, (4.0, 1.0, -0.4), (5.0, 6.0)),
            _case("the landmark is on the right", 2, (4.0, 6.0, 0.2), (5.5, 1.5)),
            _case("the robot looks to the left", 3, (7.0, 3.0, 2.4), (3.0, 6.0)),
            _case("the landmark is near", 4, (3.0, 3.0, 1.0), (3.6, 4.1)),
            _case("the landmark is behind, where directions pass 180 degrees", 6, (5.0, 4.0, 0.05), (1.0, 4.1)),
            _case("the landmark is behind, where directions pass 180 degrees", 11, (5.0, 4.0, 1.6), (5.1, 0.5)),
            _case("the robot looks where its yaw passes 180 degrees", 12, (6.0, 4.0, 3.1), (2.0, 4.4)),
        ],
    ),
    mistakes=(
        Mistake(
            "the difference of the directions is not wrapped into -180 to 180 degrees",
            {"    innovation[1] = wrap_angle(innovation[1])\n": ""},
        ),
        Mistake(
            "the difference is the wrong way round: expected minus measured",
            {"innovation = z - z_hat": "innovation = z_hat - z"},
        ),
        Mistake(
            "the robot's yaw is not subtracted from the direction",
            {"np.arctan2(dy, dx) - mean[2]": "np.arctan2(dy, dx)"},
        ),
        Mistake("x and y are exchanged in arctan2", {"np.arctan2(dy, dx) - mean[2]": "np.arctan2(dx, dy) - mean[2]"}),
        Mistake("the difference goes from the landmark to the robot", {"landmark - mean[:2]": "mean[:2] - landmark"}),
        Mistake(
            "the signs of the Jacobian's first row are wrong, or the difference of the ranges is the wrong way round",
            {"-dx / r, -dy / r, 0.0": "dx / r, dy / r, 0.0"},
        ),
        Mistake(
            "the signs of dy/q and dx/q in the Jacobian's second row are wrong",
            {"dy / q, -dx / q, -1.0": "-dy / q, dx / q, -1.0"},
        ),
        Mistake("the direction does not change with the yaw in the Jacobian", {"-dx / q, -1.0": "-dx / q, 0.0"}),
        Mistake(
            "the direction changes with the yaw with the wrong sign in the Jacobian", {"-dx / q, -1.0": "-dx / q, 1.0"}
        ),
        Mistake("dx and dy are exchanged in the Jacobian's second row", {"dy / q, -dx / q": "dx / q, -dy / q"}),
        Mistake(
            "the Jacobian's second row is divided by the range, and not by its square",
            {"dy / q, -dx / q": "dy / r, -dx / r"},
        ),
        Mistake(
            "the Jacobian's first row is divided by the square of the range", {"-dx / r, -dy / r": "-dx / q, -dy / q"}
        ),
        Mistake(
            "deviations are taken for variances: they are not squared",
            {"np.diag(deviations**2)": "np.diag(deviations)"},
        ),
        Mistake("the measurement's noise is left out", {" + np.diag(deviations**2)": ""}),
        Mistake(
            "the deviations of range and direction are exchanged",
            {"np.diag(deviations**2)": "np.diag(deviations[::-1]**2)"},
        ),
        Mistake("S is not inverted in the gain", {"np.linalg.inv(s)": "s"}),
        Mistake("the covariance stays as it was", {"(np.eye(3) - gain @ h) @ covariance": "covariance"}),
        Mistake(
            "the covariance grows: I + K H, where I - K H should be", {"np.eye(3) - gain @ h": "np.eye(3) + gain @ h"}
        ),
        Mistake("the mean stays as it was", {"mean + gain @ innovation": "mean"}),
        Mistake(
            "the square root is missing: the squared range is compared",
            {"z_hat = np.array([r,": "z_hat = np.array([q,"},
        ),
        Mistake(
            "the difference to the landmark is the wrong way round in x", {"    q = dx": "    dx = -dx\n    q = dx"}
        ),
        Mistake(
            "the difference to the landmark is the wrong way round in y", {"    q = dx": "    dy = -dy\n    q = dx"}
        ),
        Mistake(
            "the robot's yaw is added to the direction, and not subtracted",
            {"np.arctan2(dy, dx) - mean[2]": "np.arctan2(dy, dx) + mean[2]"},
        ),
        Mistake(
            "the difference of the directions is the wrong way round",
            {"wrap_angle(innovation[1])": "wrap_angle(-innovation[1])"},
        ),
        Mistake("the measurement's noise is subtracted", {"+ np.diag(deviations**2)": "- np.diag(deviations**2)"}),
        Mistake("the sign of dx/r in the Jacobian's first row is wrong", {"-dx / r": "dx / r"}),
        Mistake("the sign of dy/r in the Jacobian's first row is wrong", {"-dy / r": "dy / r"}),
        Mistake("the sign of dy/q in the Jacobian's second row is wrong", {"dy / q": "-dy / q"}),
        Mistake("the sign of dx/q in the Jacobian's second row is wrong", {"-dx / q": "dx / q"}),
        Mistake(
            "the deviation of the range is not squared",
            {"np.diag(deviations**2)": "np.diag([deviations[0], deviations[1] ** 2])"},
        ),
        Mistake(
            "the deviation of the direction is not squared",
            {"np.diag(deviations**2)": "np.diag([deviations[0] ** 2, deviations[1]])"},
        ),
        Mistake("both have the deviation of the range", {"np.diag(deviations**2)": "deviations[0] ** 2 * np.eye(2)"}),
        Mistake(
            "the covariance has the wrong sign: K H - I, where I - K H should be",
            {"np.eye(3) - gain @ h": "gain @ h - np.eye(3)"},
        ),
    ),
)
