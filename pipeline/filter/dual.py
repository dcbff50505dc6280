"""Where nobody says how the robot moved, the scan proposes poses (mixture MCL; Thrun and others, 2001)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.filter.particles import Particles
from pipeline.filter.search import COARSE, Posterior
from pipeline.filter.sensor import Reading, Sensor
from pipeline.maps.occupancy_grid import OccupancyGrid

BIN = 0.5
"""m: side of the squares in which it is counted where the belief was."""
WITHIN = 3.0
"""Deviations up to which the robot may have gone."""


def place_after(grid: OccupancyGrid, particles: Particles, reach: float) -> NDArray[np.float64]:
    """(height, width) how probable each cell is after a drive of which only the ``reach`` (m, a deviation) is known.

    Sums to one over cells that are BIN apart in both directions.
    """
    # Imported here: most runs never come so far.
    from scipy.ndimage import gaussian_filter

    per_bin = max(1, round(BIN / grid.resolution))
    bins = -(-np.array([grid.height, grid.width]) // per_bin)
    size = per_bin * grid.resolution
    row, col = (np.clip((particles.poses[k] / size).astype(np.int64), 0, bins[1 - k] - 1) for k in (1, 0))
    mass = np.bincount(row * bins[1] + col, particles.weights, minlength=int(bins.prod())).reshape(bins)
    there = gaussian_filter(mass, reach / size, mode="constant", truncate=WITHIN)
    full: NDArray[np.float64] = np.repeat(np.repeat(there, per_bin, axis=0), per_bin, axis=1)
    return full[: grid.height, : grid.width]


def proposed(
    grid: OccupancyGrid, sensor: Sensor, before: NDArray[np.float64], reading: Reading, n: int, key: np.uint64
) -> tuple[Posterior, float]:
    """n poses where both the scan and the drive may have brought the robot, and the log-evidence of having come so.

    ``before`` (height, width) as ``place_after`` gives it. The evidence is the mean of the tempered likelihood over all
    places and headings, as ``Belief.advance`` has it of particles that moved.
    """
    posterior = sensor.search_near(reading, before, n, key)
    per_bin = max(1, round(BIN / grid.resolution))
    asked = max(1, round(COARSE / grid.resolution))
    return posterior, posterior.evidence + 2.0 * float(np.log(asked / per_bin))
