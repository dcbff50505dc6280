"""The scans that teach: where the belief had converged, with what the map says that they should have measured."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.geometry import between, compose
from pipeline.kernels import raycast
from pipeline.localization import RunResult
from pipeline.logs.messages import Log
from pipeline.maps.range_table import opaque_cells, range_codes
from pipeline.tune.em import Array, Readings
from pipeline.world.expected_ranges import select_beams

CONVERGED_SPREAD = 0.5
"""m: the particles lay so close together ..."""
AGREES = 1.0
"""m: ... and so close to where hindsight saw the robot."""
FEWEST = 20
"""Scans, below which a log teaches nothing."""
NEAR = 0.1, math.radians(2.0)
"""m, rad: the pose may be wrong by so much when a scan's evidence is taken."""


def updates(way: Array, config: Config) -> NDArray[np.int64]:
    """Indices of the scans at which the filter updates its belief, for dead reckoning (n, 3): those after a move."""
    kept = [0]
    for i in range(1, len(way)):
        dx, dy, turn = between(way[kept[-1]], way[i])
        if math.hypot(dx, dy) >= config.update_min_d or abs(turn) >= config.update_min_a:
            kept.append(i)
    return np.array(kept)


def trusted(log: Log, result: RunResult, scans: NDArray[np.int64]) -> NDArray[np.int64]:
    """Those of the updates ``scans`` at which the belief had converged, to where hindsight confirms it.

    Raises MclError if there are too few, or if the run kept no hindsight.
    """
    if result.hindsight is None:
        raise MclError("tuning needs hindsight", "use --set hindsight=true", path=log.path)
    apart = np.hypot(*(result.poses - result.hindsight)[:, :2].T)
    sure = (result.spread < CONVERGED_SPREAD) & (apart < AGREES)
    scans = scans[sure[scans]]
    if len(scans) < FEWEST:
        raise MclError(
            f"the filter did not converge on this log ({len(scans)} scans to learn from)",
            "try more particles, or another --config to start from",
            path=log.path,
        )
    return scans


def readings(log: Log, poses: Array, scans: NDArray[np.int64], config: Config) -> Readings:
    """The scans' beams and their exact true ranges (Amanatides and Woo) from poses (len(scans), 3) of the map frame."""
    assert log.grid is not None
    beams = select_beams(log.laser, config)
    max_range = log.laser.longest(config.laser_max_range)
    cell = log.grid.resolution
    laser = compose(log.grid.to_grid(poses), log.laser.pose)
    in_cells = np.ascontiguousarray(laser / [cell, cell, 1.0])
    expected = np.empty((len(scans), len(beams)), np.float32)
    opaque = opaque_cells(log.grid, log.grid.wall_threshold(config.occupied_threshold))
    longest = range_codes(log.grid, max_range).max_range  # as the filter's own table has it
    raycast.cast(opaque, in_cells, log.laser.angles[beams], longest / cell, False, expected)
    measured = log.without_short(config.laser_min_range).ranges[np.ix_(scans, beams)].astype(float)
    measured[measured >= config.no_return_fraction * max_range] = np.inf
    return Readings(measured, expected.astype(float) * cell, max_range)


def displaced(log: Log, poses: Array, scans: NDArray[np.int64], config: Config, offsets: ArrayLike) -> Array:
    """(offsets, scans) log-likelihood of whole scans from poses displaced in the robot's own frame.

    ``offsets`` (m, 3): m ahead, m to the left, rad. ``config`` with its range_bias given. Untempered.
    """
    return np.stack(
        [
            readings(log, compose(poses, offset), scans, config).log_likelihood(config).sum(axis=1)
            for offset in np.asarray(offsets, float)
        ]
    )


def evidence(log: Log, poses: Array, scans: NDArray[np.int64], config: Config, temper: float) -> Array:
    """(scans,) log of the likelihood, to the power ``temper``, averaged over 27 poses around each hindsight pose.

    What one scan says for the model, be the pose wrong by as much as hindsight may be: nats.
    """
    step, turn = NEAR
    grid = np.stack(np.meshgrid([-step, 0, step], [-step, 0, step], [-turn, 0, turn]), axis=-1).reshape(-1, 3)
    likelihood = temper * displaced(log, poses, scans, config, grid)
    return np.logaddexp.reduce(likelihood, axis=0) - math.log(len(grid))
