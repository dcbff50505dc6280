"""What the laser should see from a pose: true ranges from the table, or cast ray by ray."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.kernels import raycast, scoring
from pipeline.logs.messages import Laser
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import (
    HEADINGS,
    HIT_CODES,
    LOG_OFFSET,
    UNKNOWN_CODES,
    RangeTable,
    load_range_table,
    opaque_cells,
    range_codes,
)

BIN = 2.0 * math.pi / HEADINGS


def select_beams(laser: Laser, config: Config) -> NDArray[np.int64]:
    """Indices of the beams that the sensor model uses: every ``beam_step``-th, or ``max_beams`` spread evenly."""
    if config.beam_step is not None:
        return np.arange(0, laser.beams, config.beam_step)
    n = min(config.max_beams, laser.beams)
    return np.unique(np.round((np.arange(n) + 0.5) * laser.beams / n - 0.5).astype(np.int64))


class ExpectedRanges:
    """True ranges z* for the chosen beams, as eight-bit codes; and the likelihood of a scan that follows from them.

    ``table``: of the map, if anybody needs it; ``rows`` (n, HEADINGS + span) uint8 padded, ``first``: heading of the
    beam furthest right in the table's steps, ``offsets`` (k,) int32 of the beams from it. ``half_thickness``: of the
    map's walls, m; as far inside them a laser still sees what it would see from the nearest open cell.
    """

    def __init__(
        self,
        grid: OccupancyGrid,
        laser: Laser,
        beams: NDArray[np.int64],
        config: Config,
        max_range: float,
        half_thickness: float,
    ) -> None:
        self._grid, self._laser, self._config = grid, laser, config
        self._angles = laser.angles[beams]
        self.codes = range_codes(grid, max_range)
        self._laser_pose = np.asarray(laser.pose, np.float32)
        # Searching the whole building needs the table, whoever casts the rays of the particles.
        self._casts = config.ray_caster != "table"
        searches = config.init == "exhaustive" or config.recovery == "search"
        self.table: RangeTable | None = None
        if self._casts:
            self._opaque = opaque_cells(grid, grid.wall_threshold(config.occupied_threshold))
        if searches or not self._casts:
            # Beams as steps of the table's headings from the first beam, so that a row is read forwards only.
            steps = np.round(self._angles / BIN).astype(np.int64)
            self.first = int(steps.min())
            self.offsets = ((steps - self.first) % HEADINGS).astype(np.int32)
            span = int(self.offsets.max())
            self.table = load_range_table(grid, grid.wall_threshold(config.occupied_threshold), max_range, span)
            self.rows = self.table.padded(span)
            row_of_cell = self.table.rows_through_walls(half_thickness / grid.resolution)
            x, y, yaw = self._laser_pose
            # What the kernels need to find a pose's place in the table.
            turn, cells = np.float32(yaw + self.first * BIN), np.float32(1.0 / grid.resolution)
            self.place = (x, y, turn, cells, HEADINGS, row_of_cell)

    def score(
        self,
        poses: NDArray[np.float32],
        log_likelihood: NDArray[np.float32],
        outside: float,
        out: NDArray[np.float32],
    ) -> None:
        """Log-likelihood of a scan at poses (3, n) float32 in the grid frame -> ``out`` (n,) float32.

        ``log_likelihood`` (k, 256) float32 of the scan's beams; ``outside`` for poses in walls or off the map.
        """
        n, k = poses.shape[1], len(self._angles)
        if self._casts:
            codes = np.empty((n, k), np.uint8)
            self._cast_codes(poses, codes)
            scoring.score_codes(n * k, codes, log_likelihood, np.float32(outside), out)
        else:
            table = (self.rows, self.offsets, log_likelihood, np.float32(outside))
            scoring.score(n * k, *poses, *self.place, *table, out)

    def codes_at(self, poses: NDArray[np.float64]) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """(n, k) uint8 codes of those ranges from poses (n, 3), and (n,) which see nothing: in a wall, off the map."""
        columns = np.ascontiguousarray(poses.T.astype(np.float32))
        codes = np.zeros((len(poses), len(self._angles)), np.uint8)
        if self._casts:
            self._cast_codes(columns, codes)
        else:
            scoring.look_up(*columns, *self.place, self.rows, self.offsets, codes)
        blind: NDArray[np.bool_] = np.max(codes, axis=1) == 0
        return codes, blind

    def _cast_codes(self, poses: NDArray[np.float32], out: NDArray[np.uint8]) -> None:
        cell = self._grid.resolution
        x, y, theta = poses[0] / np.float32(cell), poses[1] / np.float32(cell), poses[2]
        lx, ly, yaw = self._laser_pose
        raycast.cast_codes(
            50 * out.size, self._opaque, x, y, theta, lx / cell, ly / cell, yaw, self._angles,
            self.codes.max_range / cell, self._config.ray_caster == "bresenham",
            self.codes.scale, LOG_OFFSET / cell, HIT_CODES, UNKNOWN_CODES, out,
        )  # fmt: skip
