"""Where rays meet segments and discs, exactly: no grid, so that no ray caster of the filter's is tested on itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

EPSILON = 1e-9  # closes the hairline between two segments that share an end


def segment_hits(origin: Array, directions: Array, segments: Array) -> Array:
    """How far from ``origin`` each ray meets each segment.

    ``origin`` (2,) or (n, 2) m; ``directions`` (n, 2) unit vectors; ``segments`` (m, 4) as x0, y0, x1, y1 in m.
    Returns (n, m) m, inf where they do not meet; a ray along a segment does not meet it.
    """
    edge = segments[:, 2:] - segments[:, :2]
    to_start = segments[:, :2] - np.atleast_2d(origin)[:, None, :]
    across = _cross(directions[:, None, :], edge)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        distance = _cross(to_start, edge) / across
        along = _cross(to_start, directions[:, None, :]) / across
    met = (np.abs(across) > EPSILON) & (distance > 0.0) & (along >= -EPSILON) & (along <= 1.0 + EPSILON)
    return np.where(met, distance, np.inf)


def disc_hits(origin: Array, directions: Array, discs: Array) -> Array:
    """How far from ``origin`` each ray enters each disc.

    ``origin`` (2,) or (n, 2) m; ``directions`` (n, 2) unit vectors; ``discs`` (m, 3) as x, y, radius in m.
    Returns (n, m) m, inf where they do not meet; a ray that starts inside a disc leaves it unseen.
    """
    to_centre = discs[:, :2] - np.atleast_2d(origin)[:, None, :]
    along = np.sum(to_centre * directions[:, None, :], axis=-1)
    off = _cross(directions[:, None, :], to_centre)
    half_chord = np.sqrt(np.maximum(discs[:, 2] ** 2 - off**2, 0.0))
    distance = along - half_chord
    return np.where((np.abs(off) <= discs[:, 2]) & (distance > 0.0), distance, np.inf)


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
