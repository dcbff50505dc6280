"""Poses in the plane. A pose is (x, y, yaw): metres, metres, radians counter-clockwise (REP 103)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Pose = tuple[float, float, float]


def wrap_angle(angle: ArrayLike) -> NDArray[np.float64]:
    """Angle(s) in radians, brought into [-pi, pi)."""
    return (np.asarray(angle, dtype=np.float64) + np.pi) % (2 * np.pi) - np.pi


def compose(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Pose b, given in frame a, expressed in a's parent: a (+) b.

    ``a`` and ``b``: (..., 3), broadcast against each other; the yaw of the result is wrapped.
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if a.ndim == b.ndim == 1:
        # A single pose: numpy's machinery for broadcasting would take five times as long, several times a scan.
        cos1, sin1 = math.cos(a[2]), math.sin(a[2])
        yaw = (a[2] + b[2] + math.pi) % (2.0 * math.pi) - math.pi
        return np.array([a[0] + cos1 * b[0] - sin1 * b[1], a[1] + sin1 * b[0] + cos1 * b[1], yaw])
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack(
        [
            a[..., 0] + cos * b[..., 0] - sin * b[..., 1],
            a[..., 1] + sin * b[..., 0] + cos * b[..., 1],
            wrap_angle(a[..., 2] + b[..., 2]),
        ],
        axis=-1,
    )


def inverse(a: ArrayLike) -> NDArray[np.float64]:
    """The pose that undoes a: compose(a, inverse(a)) is the identity. ``a``: (..., 3)."""
    a = np.asarray(a, dtype=np.float64)
    if a.ndim == 1:
        cos1, sin1 = math.cos(a[2]), math.sin(a[2])
        yaw = (-a[2] + math.pi) % (2.0 * math.pi) - math.pi
        return np.array([-cos1 * a[0] - sin1 * a[1], sin1 * a[0] - cos1 * a[1], yaw])
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack(
        [-cos * a[..., 0] - sin * a[..., 1], sin * a[..., 0] - cos * a[..., 1], wrap_angle(-a[..., 2])], axis=-1
    )


def between(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Pose b as seen from a: compose(a, between(a, b)) is b. Both (..., 3) in the same frame."""
    return compose(inverse(a), b)


def yaw_to_quaternion(yaw: float) -> tuple[float, float, float, float]:
    """Quaternion (x, y, z, w) of a turn by yaw radians about z."""
    return (0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))


def quaternion_to_yaw(x: ArrayLike, y: ArrayLike, z: ArrayLike, w: ArrayLike) -> NDArray[np.float64]:
    """Yaw in radians of quaternion(s); exact for turns about z, the heading of the x axis otherwise."""
    x, y, z, w = (np.asarray(c, dtype=np.float64) for c in (x, y, z, w))
    return np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
