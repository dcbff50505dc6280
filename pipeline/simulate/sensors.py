"""What the robot's sensors say of the truth: odometry that drifts, a laser that glass and people fool."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import between, compose
from pipeline.simulate.building import Imu, Laser, Odometry
from pipeline.simulate.rays import disc_hits, nearest_segments, segment_hits
from pipeline.simulate.world import World

Array = NDArray[np.float64]

STANDS_STILL = 1e-6  # metres: less travel than this has no direction


def measure_odometry(truth: Array, noise: Odometry, rng: np.random.Generator) -> Array:
    """Odometry of a true motion, as Probabilistic Robotics' Table 5.6 disturbs it, with a systematic error on top.

    ``truth`` (n, 3): poses of the centre at the readings' stamps. Returns (n, 3) in the odom frame, m and rad,
    starting at ``noise.start``, yaw unwrapped.
    """
    rotation1, translation, rotation2 = decompose(between(truth[:-1], truth[1:]))
    a1, a2, a3, a4 = noise.alpha1, noise.alpha2, noise.alpha3, noise.alpha4
    draws = rng.standard_normal((3, len(translation)))
    deviation1 = np.sqrt(a1 * rotation1**2 + a2 * translation**2)
    deviation = np.sqrt(a3 * translation**2 + a4 * (rotation1**2 + rotation2**2))
    deviation2 = np.sqrt(a1 * rotation2**2 + a2 * translation**2)
    drift = np.deg2rad(noise.drift_deg) * np.abs(translation) / 2
    rotation1 = rotation1 + draws[0] * deviation1 + drift
    translation = noise.scale * translation + draws[1] * deviation
    rotation2 = rotation2 + draws[2] * deviation2 + drift
    yaw = noise.start[2] + np.concatenate([[0.0], np.cumsum(rotation1 + rotation2)])
    heading = yaw[:-1] + rotation1
    x = noise.start[0] + np.concatenate([[0.0], np.cumsum(translation * np.cos(heading))])
    y = noise.start[1] + np.concatenate([[0.0], np.cumsum(translation * np.sin(heading))])
    return np.stack([x, y, yaw], axis=-1)


def decompose(motion: Array) -> tuple[Array, Array, Array]:
    """A motion (..., 3) in the robot's frame as a turn (rad), a drive (m, negative is backwards) and a turn (rad).

    Driving backwards is not turning round, driving, turning round: that would add the noise of two half turns.
    """
    dx, dy, turn = motion[..., 0], motion[..., 1], motion[..., 2]
    sign = np.where(dx < 0.0, -1.0, 1.0)
    distance = np.hypot(dx, dy)
    rotation1 = np.where(distance > STANDS_STILL, np.arctan2(sign * dy, sign * dx), 0.0)
    return rotation1, sign * distance, turn - rotation1


def measure_turn_rates(yaw_before: Array, yaw_after: Array, imu: Imu, rng: np.random.Generator) -> Array:
    """What a gyroscope says, rad/s (n,), of turns from ``yaw_before`` to ``yaw_after`` (n,) rad, a period apart."""
    rates = (yaw_after - yaw_before) * imu.rate
    return np.asarray(rates + imu.bias + imu.noise * rng.standard_normal(len(rates)))


def true_ranges(world: World, people: Array, origin: Array, angles: Array, seen: NDArray[np.bool_]) -> Array:
    """Exact distance from ``origin`` (2,) or (n, 2) to what stops a ray in each of the directions ``angles`` (n,).

    ``people``: discs (p, 3), or (n, p, 3) where they are when each ray is measured; ``seen`` (n, g): whether the ray,
    should it meet pane g, returns from it. Metres, inf where nothing stops the ray.
    """
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    panes = np.where(seen, segment_hits(origin, directions, world.panes), np.inf)
    ranges = [nearest_segments(origin, angles, world.edges)]
    for hits in (panes, disc_hits(origin, directions, world.discs), disc_hits(origin, directions, people)):
        ranges.append(hits.min(axis=1, initial=np.inf))
    return np.asarray(np.min(ranges, axis=0))


def measure_ranges(world: World, people: Array, pose: Array, laser: Laser, rng: np.random.Generator) -> Array:
    """One scan from the robot's centre at ``pose``: ranges (beams,) in metres as they are measured, inf = no return.

    ``pose`` (3,) and ``people`` (p, 3), or, where they move while the scan is measured, one row for every beam:
    (beams, 3) and (beams, p, 3).
    """
    origin = compose(pose, laser.mount)
    seen = rng.random((laser.beams, len(world.panes))) < world.seen
    error, kind, anywhere = rng.standard_normal(laser.beams), rng.random(laser.beams), rng.random(laser.beams)
    ranges = true_ranges(world, people, origin[..., :2], origin[..., 2] + laser.bearings, seen)
    ranges = np.maximum(ranges + laser.sigma * error, 0.01)
    ranges = np.where(kind < laser.random, anywhere * laser.max_range, ranges)
    return np.where((kind >= 1.0 - laser.missing) | (ranges > laser.max_range), np.inf, ranges)
