"""Walls as straight lines: found in a scan by split and merge, each with how well it is known.

(Nguyen, Martinelli, Tomatis, Siegwart, IROS 2005, compare ways to find them; Siegwart and Nourbakhsh, Section 4.7.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.geometry import wrap_angle

Array = NDArray[np.float64]

NEAR_LINE = 0.06
"""m: a wall's points are no farther from its line."""
JUMP, PER_METRE = 0.3, 0.1
"""m: neighbouring points farther apart, plus so much for each metre of range, are of different walls."""
FEWEST, SHORTEST = 6, 0.5
"""Points, and m, that a line needs."""
NOISE = 0.03
"""m: deviation of a point across its wall."""


@dataclass(frozen=True)
class Line:
    """A wall: ``alpha`` (rad) is the direction of its normal, ``r`` (m, not negative) its distance from the origin,
    ``covariance`` (2, 2) of both; ``members``: indices of its points; ``rms``: m, of the points from the line."""

    alpha: float
    r: float
    covariance: Array
    members: NDArray[np.int64]
    rms: float


def fit_line(points: Array, members: NDArray[np.int64]) -> Line:
    """The line with the least squares of distances from points (n, 2) m."""
    centre = points.mean(axis=0)
    off = points - centre
    _, vectors = np.linalg.eigh(off.T @ off)
    normal, along = vectors[:, 0], vectors[:, 1]
    if normal @ centre < 0.0:
        normal = -normal
    at, from_origin = off @ along, float(along @ centre)
    # A turn of the line about its centre of mass moves its distance from the origin as well.
    if along @ np.array([-normal[1], normal[0]]) < 0.0:
        from_origin = -from_origin
    turn = NOISE**2 / float(at @ at)
    shift = NOISE**2 / len(points)
    covariance = np.array([[turn, from_origin * turn], [from_origin * turn, shift + from_origin**2 * turn]])
    rms = math.sqrt(float(np.mean((off @ normal) ** 2)))
    return Line(math.atan2(normal[1], normal[0]), float(normal @ centre), covariance, members, rms)


def find_lines(points: Array) -> list[Line]:
    """The lines in a scan's points (n, 2) m, in the order of their beams; NaN where a beam shows none."""
    seen = np.flatnonzero(np.isfinite(points).all(axis=1))
    if len(seen) < FEWEST:
        return []
    there = points[seen]
    apart = np.hypot(*np.diff(there, axis=0).T)
    allowed = JUMP + PER_METRE * np.hypot(*there[:-1].T)
    runs = np.split(np.arange(len(seen)), np.flatnonzero(apart > allowed) + 1)
    parts = [part for run in runs for part in _split(there, run)]
    lines = []
    for part in parts:
        if len(part) < FEWEST or math.dist(there[part[0]], there[part[-1]]) < SHORTEST:
            continue
        line = fit_line(there[part], seen[part])
        if line.rms < NEAR_LINE:
            lines.append(line)
    return lines


def _split(points: Array, part: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """The part, cut in two wherever a point is too far from the line between its ends."""
    if len(part) < FEWEST:
        return [part]
    first, last = points[part[0]], points[part[-1]]
    way = last - first
    length = math.hypot(way[0], way[1])
    if length < 1e-9:
        return [part]
    off = np.abs((points[part] - first) @ np.array([-way[1], way[0]])) / length
    worst = int(np.argmax(off))
    if off[worst] <= NEAR_LINE or worst in (0, len(part) - 1):
        return [part]
    return [*_split(points, part[: worst + 1]), *_split(points, part[worst:])]


def apart(seen: Line, expected: Line) -> Array:
    """(2,) by how much a line differs from another: normal (rad) and distance (m).

    Close to the origin a line's normal may point either way, for the same line.
    """
    turn = float(wrap_angle(seen.alpha - expected.alpha))
    if abs(turn) > math.pi / 2:
        return np.array([float(wrap_angle(turn + math.pi)), -seen.r - expected.r])
    return np.array([turn, seen.r - expected.r])
