"""What was measured beside what the model says: the data of the pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.config import Config
from pipeline.filter.own_sensor import beam_density
from pipeline.tune.em import Array, Readings

REACH, STEP = 3.0, 0.05
"""m: residuals are shown so far to both sides, in bins so wide."""
CELL = 0.2
"""m: side of a bin of the plane of measured and true ranges."""
SAMPLE = 4000
"""True ranges over which the model's density is averaged."""


@dataclass(frozen=True)
class Residuals:
    """Densities (k,) per metre of what was measured less what the map says, bins centred at ``at`` (k,) m."""

    at: Array
    measured: Array
    before: Array
    after: Array


@dataclass(frozen=True)
class Plane:
    """Densities (n, n) per metre of measured ranges (rows) given true ranges (columns), in bins that end at ``reach``;
    NaN where no beam had such a true range."""

    reach: float
    measured: Array
    fitted: Array


def residuals(readings: Sequence[Readings], before: Config, after: Config) -> Residuals:
    """Of all readings with a return and a true range; ``before`` is judged at the true ranges found after."""
    z, star = _finite(readings)
    at = np.arange(-REACH + STEP / 2, REACH, STEP)
    counts = np.histogram(z - star, np.append(at - STEP / 2, at[-1] + STEP / 2))[0]
    some = star[:: max(1, -(-len(star) // SAMPLE))]
    far = max(r.max_range for r in readings)
    returned = max(sum(int(np.count_nonzero(np.isfinite(r.expected) & ~np.isnan(r.measured))) for r in readings), 1)
    return Residuals(at, counts / (STEP * returned), *(_along(at, some, config, far) for config in (before, after)))


def plane(readings: Sequence[Readings], config: Config) -> Plane:
    """Up to the range below which 98 % of the true ranges lie."""
    z, star = _finite(readings)
    n = max(1, int(np.quantile(star, 0.98) / CELL)) if len(star) else 1
    edges = CELL * np.arange(n + 1)
    counts = np.histogram2d(z, star, (edges, edges))[0]
    columns = np.histogram(star, edges)[0]
    measured = np.full((n, n), np.nan)
    measured[:, columns > 0] = counts[:, columns > 0] / (CELL * columns[columns > 0])
    centres = edges[:-1] + CELL / 2
    assert config.range_bias is not None
    far = max(r.max_range for r in readings)
    seen = np.maximum(centres - config.range_bias, 0.0)
    fitted = beam_density(config, far).density(*np.broadcast_arrays(seen[:, None], centres))
    return Plane(n * CELL, measured, np.where(columns > 0, fitted, np.nan))


def _along(at: Array, star: Array, config: Config, far: float) -> Array:
    """Mean over true ranges of the density of a raw reading at star + at; none of them is negative."""
    assert config.range_bias is not None
    raw = star[:, None] + at
    seen = np.maximum(raw - config.range_bias, 0.0)
    density = beam_density(config, far).density(*np.broadcast_arrays(seen, star[:, None]))
    return np.where((raw >= 0.0) & (raw <= far), density, 0.0).mean(axis=0)


def _finite(readings: Sequence[Readings]) -> tuple[Array, Array]:
    z = np.concatenate([r.measured.ravel() for r in readings])
    star = np.concatenate([r.expected.ravel() for r in readings])
    both = np.isfinite(z) & np.isfinite(star)
    return z[both], star[both]
