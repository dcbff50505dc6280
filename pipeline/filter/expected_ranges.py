"""What the laser should see from a pose: true ranges from the table, or cast ray by ray."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.geometry import compose, inverse
from pipeline.kernels import exhaustive, raycast, scoring
from pipeline.kernels.random import uniforms
from pipeline.logs.messages import Laser
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import (
    HEADINGS,
    HIT_CODES,
    LOG_OFFSET,
    UNKNOWN_CODES,
    load_range_table,
    opaque_cells,
    range_codes,
)
from pipeline.maps.walls import wall_half_thickness

BIN = 2.0 * math.pi / HEADINGS
SEARCH_BEAMS = 24
"""Beams that a search of the whole building uses: more would cost in proportion and tell little that is new."""


def select_beams(laser: Laser, config: Config) -> NDArray[np.int64]:
    """Indices of the beams that the sensor model uses: every ``beam_step``-th, or ``max_beams`` spread evenly."""
    if config.beam_step is not None:
        return np.arange(0, laser.beams, config.beam_step)
    n = min(config.max_beams, laser.beams)
    return np.unique(np.round((np.arange(n) + 0.5) * laser.beams / n - 0.5).astype(np.int64))


@dataclass(frozen=True)
class Posterior:
    """What one scan says of every place in the building.

    ``poses`` (3, n) float32 drawn from it, grid frame; ``cells`` (m,) int32 flat indices of the open cells and
    ``best`` (m,) float32 the log-likelihood of the best heading in each, -inf where no robot can stand.
    ``log_evidence``: log of the tempered likelihood, averaged over every pose that the robot could have.
    """

    poses: NDArray[np.float32]
    cells: NDArray[np.int32]
    best: NDArray[np.float32]
    log_evidence: float


class ExpectedRanges:
    """True ranges z* for the chosen beams, as eight-bit codes; and the likelihood of a scan that follows from them."""

    def __init__(
        self, grid: OccupancyGrid, laser: Laser, beams: NDArray[np.int64], config: Config, max_range: float
    ) -> None:
        self._grid, self._laser, self._config = grid, laser, config
        self._angles = laser.angles[beams]
        self.codes = range_codes(grid, max_range)
        self._laser_pose = np.asarray(laser.pose, np.float32)
        # Searching the whole building needs the table, whoever casts the rays of the particles.
        self._casts = config.ray_caster != "table"
        searches = config.init == "exhaustive" or config.recovery == "search"
        self._table = None
        if self._casts:
            self._opaque = opaque_cells(grid, config.occupied_threshold)
        if searches or not self._casts:
            self._table = load_range_table(grid, config.occupied_threshold, max_range)
            # Beams as steps of the table's headings from the first beam, so that a row is read forwards only.
            steps = np.round(self._angles / BIN).astype(np.int64)
            self._first = int(steps.min())
            self._offsets = ((steps - self._first) % HEADINGS).astype(np.int32)
            self._rows = self._table.padded(int(self._offsets.max()))
            thickness = wall_half_thickness(grid, config.occupied_threshold)
            self._row_of_cell = self._table.rows_through_walls(thickness / grid.resolution)

    def score(
        self, poses: NDArray[np.float32], log_likelihood: NDArray[np.float32], outside: float, out: NDArray[np.float32]
    ) -> None:
        """Log-likelihood of a scan at poses (3, n) float32 in the grid frame -> ``out`` (n,) float32.

        ``log_likelihood`` (k, 256) float32 of the scan's beams; ``outside`` for poses in walls or off the map.
        """
        n, k = poses.shape[1], len(self._angles)
        x, y, yaw = self._laser_pose
        if self._casts:
            codes = np.empty((n, k), np.uint8)
            self._cast_codes(poses, codes)
            scoring.score_codes(n * k, codes, log_likelihood, np.float32(outside), out)
        else:
            turn = np.float32(yaw + self._first * BIN)
            inv = np.float32(1.0 / self._grid.resolution)
            table = (HEADINGS, self._row_of_cell, self._rows, self._offsets, log_likelihood, np.float32(outside))
            scoring.score(n * k, *poses, x, y, turn, inv, *table, out)

    def posterior(
        self,
        log_likelihood: NDArray[np.float32],
        independent_beams: float | None,
        allowed: NDArray[np.bool_],
        n: int,
        key: np.uint64,
    ) -> Posterior:
        """Score every open cell and heading against one scan, and draw n poses from the tempered posterior.

        ``log_likelihood`` (k, 256) float32 of the scan's beams, thinned to SEARCH_BEAMS of those that say something;
        ``allowed`` (height, width) bool: where the robot's centre may be. Raises MclError without a table of ranges.
        """
        if self._table is None:
            raise MclError("an exhaustive search needs the table of ranges", "use --set ray_caster=table")
        cells, cell_size = self._table.cells, self._grid.resolution
        headings = (
            np.arange(HEADINGS) - self._first
        ) * BIN  # of the laser itself; the table counts from the first beam
        to_robot = compose(np.stack([0 * headings, 0 * headings, headings], -1), inverse(self._laser.pose))
        robot_dx, robot_dy = to_robot[:, 0] / cell_size, to_robot[:, 1] / cell_size
        telling = np.flatnonzero(np.ptp(log_likelihood, axis=1) > 0.0)
        used = telling[:: max(1, -(-len(telling) // SEARCH_BEAMS))]
        temper = 1.0 if independent_beams is None else min(1.0, independent_beams / max(1, len(used)))
        scoring = (cells, self._rows, HEADINGS, self._offsets[used], np.ascontiguousarray(log_likelihood[used]))
        place = (robot_dx, robot_dy, allowed)
        best, log_mass = np.empty(len(cells), np.float32), np.empty(len(cells), np.float32)
        work = len(cells) * HEADINGS * len(used)
        exhaustive.cell_masses(work, *scoring, np.float32(temper), *place, best, log_mass)
        top = float(log_mass.max())
        if top == -np.inf:
            raise MclError("the map has no free cell in which the robot and its laser fit", "raise free_threshold")
        mass = np.exp(log_mass.astype(np.float64) - top)
        log_evidence = top + float(np.log(mass.sum() / (np.count_nonzero(allowed) * HEADINGS)))
        draws = np.empty(len(cells), np.int64)
        exhaustive.split_draws(mass / mass.sum(), uniforms(key, 1)[0], n, draws)
        chosen = np.flatnonzero(draws)
        first = np.concatenate([[0], np.cumsum(draws[chosen])])
        at_cell, at_heading = np.empty(n, np.int32), np.empty(n, np.int32)
        work = len(chosen) * HEADINGS * len(used)
        exhaustive.draw_headings(
            work, chosen, first, *scoring, np.float32(temper), *place, self._grid.width, at_cell, at_heading
        )
        # Anywhere within the cell and the heading's bin: the table cannot tell these apart.
        jitter = uniforms(key + np.uint64(1), 3 * n).reshape(3, n)
        laser = np.stack(
            [
                (at_cell % self._grid.width + jitter[0]) * cell_size,
                (at_cell // self._grid.width + jitter[1]) * cell_size,
                (at_heading - self._first + jitter[2] - 0.5) * BIN,
            ],
            axis=-1,
        )
        poses = compose(laser, inverse(self._laser.pose))
        return Posterior(np.ascontiguousarray(poses.T.astype(np.float32)), cells, best, log_evidence)

    def at(self, pose: NDArray[np.float64]) -> NDArray[np.float32]:
        """(k,) float32 true ranges in metres from one robot pose (3,) of the grid frame, by the configured caster."""
        codes = np.zeros((1, len(self._angles)), np.uint8)
        if self._casts:
            self._cast_codes(np.asarray(pose, np.float32)[:, None], codes)
        else:
            x, y, theta = np.asarray(pose, np.float32)
            inv = np.float32(1.0 / self._grid.resolution)
            lx, ly, yaw = self._laser_pose
            turn = np.float32(yaw + self._first * BIN)
            row, heading = scoring.look_up(x, y, theta, lx, ly, turn, inv, HEADINGS, self._row_of_cell)
            if row >= 0:
                codes[0] = self._rows[row, heading + self._offsets]
        return self.codes.ranges[codes[0]].astype(np.float32)

    def _cast_codes(self, poses: NDArray[np.float32], out: NDArray[np.uint8]) -> None:
        cell = self._grid.resolution
        x, y, theta = poses[0] / np.float32(cell), poses[1] / np.float32(cell), poses[2]
        lx, ly, yaw = self._laser_pose
        raycast.cast_codes(
            50 * out.size, self._opaque, x, y, theta, lx / cell, ly / cell, yaw, self._angles,
            self.codes.max_range / cell, self._config.ray_caster == "bresenham",
            self.codes.scale, LOG_OFFSET / cell, HIT_CODES, UNKNOWN_CODES, out,
        )  # fmt: skip
