"""Where rays meet segments and discs, exactly: no grid, so that no ray caster of the filter's is tested on itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

EPSILON = 1e-9  # closes the hairline between two segments that share an end
SLACK = 1e-6  # metres by which a segment counts as larger when rays are sought for it: far more than rounding


def segment_hits(origin: Array, directions: Array, segments: Array) -> Array:
    """How far from ``origin`` each ray meets each segment.

    ``origin`` (2,) or (n, 2) m; ``directions`` (n, 2) unit vectors; ``segments`` (m, 4) as x0, y0, x1, y1 in m.
    Returns (n, m) m, inf where they do not meet; a ray along a segment does not meet it.
    """
    edge = segments[:, 2:] - segments[:, :2]
    to_start = segments[:, :2] - np.atleast_2d(origin)[:, None, :]
    return _meet(to_start, edge, directions[:, None, :])


def nearest_segments(origin: Array, angles: Array, segments: Array) -> Array:
    """How far from ``origin`` each ray meets the first segment in its way: the least of ``segment_hits``, but sooner.

    ``origin`` (2,) or (n, 2) m; ``angles`` (n,) rad; ``segments`` (m, 4) as x0, y0, x1, y1 in m. Returns (n,) m, inf
    where a ray meets none. Only the rays that look between a segment's ends are held against it.
    """
    origins = np.atleast_2d(origin)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    rays, which = _candidates(origins, angles, segments)
    starts = segments[which, :2]
    to_start = starts - (origins if len(origins) == 1 else origins[rays])
    ranges = np.full(len(angles), np.inf)
    np.minimum.at(ranges, rays, _meet(to_start, segments[which, 2:] - starts, directions[rays]))
    return ranges


def disc_hits(origin: Array, directions: Array, discs: Array) -> Array:
    """How far from ``origin`` each ray enters each disc.

    ``origin`` (2,) or (n, 2) m; ``directions`` (n, 2) unit vectors; ``discs`` (m, 3) as x, y, radius in m, or
    (n, m, 3) if they are elsewhere for every ray. Returns (n, m) m, inf where they do not meet; a ray that starts
    inside a disc leaves it unseen.
    """
    to_centre = discs[..., :2] - np.atleast_2d(origin)[:, None, :]
    along = to_centre[..., 0] * directions[:, None, 0] + to_centre[..., 1] * directions[:, None, 1]
    off = _cross(directions[:, None, :], to_centre)
    half_chord = np.sqrt(np.maximum(discs[..., 2] ** 2 - off**2, 0.0))
    distance = along - half_chord
    return np.where((np.abs(off) <= discs[..., 2]) & (distance > 0.0), distance, np.inf)


def _meet(to_start: Array, edge: Array, direction: Array) -> Array:
    """Distances at which rays meet segments that start ``to_start`` from where the rays do; all (..., 2)."""
    across = _cross(direction, edge)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        distance = _cross(to_start, edge) / across
        along = _cross(to_start, direction) / across
    met = (np.abs(across) > EPSILON) & (distance > 0.0) & (along >= -EPSILON) & (along <= 1.0 + EPSILON)
    return np.where(met, distance, np.inf)


def _candidates(origins: Array, angles: Array, segments: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of a ray and a segment, as two arrays of indices, among which are all that can meet.

    Seen from the middle of the origins a segment fills an angle; by what the origins are off the middle it is widened.
    """
    middle = origins.mean(axis=0)
    off = float(np.hypot(*(origins - middle).T).max()) + SLACK
    ends = segments.reshape(-1, 2, 2) - middle
    away = np.maximum(np.hypot(ends[..., 0], ends[..., 1]), SLACK)
    margin = np.arcsin(np.minimum(off / away, 1.0))
    begin = np.arctan2(ends[..., 1], ends[..., 0])
    begin[:, 1] = begin[:, 0] + (begin[:, 1] - begin[:, 0] + np.pi) % (2 * np.pi) - np.pi
    low, high = (begin - margin).min(axis=1), (begin + margin).max(axis=1)
    close = _distance_from_zero(ends) <= 2.0 * off
    width = np.where(close, 2 * np.pi, np.minimum(high - low, 2 * np.pi))
    low %= 2 * np.pi

    turned = angles % (2 * np.pi)
    order = np.argsort(turned, kind="stable")
    twice = np.concatenate([turned[order], turned[order] + 2 * np.pi])
    first = np.searchsorted(twice, low, "left")
    counts = np.minimum(np.searchsorted(twice, low + width, "right") - first, len(angles))
    counts[close] = len(angles)
    which = np.repeat(np.arange(len(segments)), counts)
    place = np.arange(len(which)) + np.repeat(first - (np.cumsum(counts) - counts), counts)
    return order[place % len(angles)], which


def _distance_from_zero(ends: Array) -> Array:
    """How far segments, by their ends (m, 2, 2), are from (0, 0)."""
    edge = ends[:, 1] - ends[:, 0]
    squared = np.maximum((edge**2).sum(axis=-1), SLACK**2)
    along = np.clip(-(ends[:, 0] * edge).sum(axis=-1) / squared, 0.0, 1.0)
    nearest = ends[:, 0] + along[:, None] * edge
    return np.asarray(np.hypot(nearest[:, 0], nearest[:, 1]))


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
