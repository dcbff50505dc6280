"""Where in the building could this scan have been taken? Every open cell and every heading is asked."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import compose, inverse
from pipeline.kernels import exhaustive
from pipeline.kernels.random import uniforms
from pipeline.logs.messages import Laser
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import HEADINGS
from pipeline.world.expected_ranges import BIN, ExpectedRanges

COARSE = 0.2
"""Metres between the cells that a coarse search asks: the laser's own noise is hardly finer."""
SEARCH_BEAMS = 24
"""Beams that a search uses: more would cost in proportion and tell little that is new."""


@dataclass(frozen=True)
class Posterior:
    """What one scan says of every place in the building.

    ``poses`` (3, n) float32 drawn from it, grid frame; ``cells`` (m,) int32 flat indices of the cells that can hold the
    laser and ``best`` (m,) float32 the log-likelihood of the best heading in each, tempered. ``evidence``: logarithm
    of the tempered likelihood's mean over the places that were asked, or of its sum weighed by how probable they were.
    """

    poses: NDArray[np.float32]
    cells: NDArray[np.int32]
    best: NDArray[np.float32]
    evidence: float


class Search:
    """Scores every pose in which the robot stands in a free cell and its laser in an open one."""

    def __init__(self, grid: OccupancyGrid, laser: Laser, expected: ExpectedRanges, free_threshold: float) -> None:
        if expected.table is None:
            raise MclError("an exhaustive search needs the table of ranges", "use --set ray_caster=table")
        self._grid, self._laser, self._expected, self._table = grid, laser, expected, expected.table
        self._allowed = grid.free(free_threshold)
        # The laser's own heading: the table's rows count from the first beam.
        heading = (np.arange(HEADINGS) - expected.first) * BIN
        laser_poses = np.stack([np.zeros(HEADINGS), np.zeros(HEADINGS), heading], axis=-1)
        to_robot = compose(laser_poses, inverse(laser.pose))[:, :2] / grid.resolution
        col, row = np.floor(0.5 + to_robot).astype(np.int64).T
        self._place = (np.ascontiguousarray(col), np.ascontiguousarray(row), self._allowed)
        # Most headings put the robot into the same few cells around the laser's.
        around = np.unique(np.stack([col, row]), axis=1)
        count = np.empty(len(self._table.cells), np.int32)
        work = 2 * count.size * around.shape[1]
        exhaustive.count_standing(work, self._table.cells, *around, self._allowed, count)
        self._rows, self._open_around = np.flatnonzero(count), count == around.shape[1]
        apart = max(1, round(COARSE / grid.resolution))
        row, col = np.divmod(self._table.cells[self._rows], grid.width)
        self._coarse_rows = self._rows[(row % apart == 0) & (col % apart == 0)]
        if len(self._rows) == 0:
            raise MclError("the map has no free cell in which the robot and its laser fit", "raise free_threshold")

    @property
    def cells(self) -> int:
        """How many cells a search asks that is not coarse."""
        return len(self._rows)

    def __call__(
        self,
        log_likelihood: NDArray[np.float32],
        independent_beams: float | None,
        n: int,
        key: np.uint64,
        coarse: bool = False,
        beams: int = SEARCH_BEAMS,
        before: NDArray[np.float64] | None = None,
    ) -> Posterior:
        """n poses drawn from the tempered posterior of one scan; ``coarse``: not every cell is asked.

        ``log_likelihood`` (k, 256) float32 is thinned to so many ``beams`` of those that say something. ``before``
        (height, width): how probable each cell of the map was before the scan, and only where it was is asked.
        """
        telling = np.flatnonzero(np.ptp(log_likelihood, axis=1) > 0.0)
        used = telling[:: max(1, -(-len(telling) // beams))]
        temper = 1.0 if independent_beams is None else min(1.0, independent_beams / max(1, len(used)))
        scan = (self._expected.offsets[used], np.ascontiguousarray(log_likelihood[used]), np.float32(temper))
        table = (self._table.cells, self._open_around, self._expected.rows)
        rows = self._coarse_rows if coarse and len(self._coarse_rows) else self._rows
        known = np.full(len(rows), 1.0 / len(rows))
        if before is not None:
            known = before.reshape(-1)[self._table.cells[rows]]
            if known.any():
                rows, known = rows[known > 0.0], known[known > 0.0]
            else:  # whoever is nowhere may be anywhere
                known = np.full(len(rows), 1.0 / len(rows))
        work = HEADINGS * len(used)
        best, log_mass = np.empty(len(rows), np.float32), np.empty(len(rows), np.float32)
        exhaustive.cell_masses(len(rows) * work, rows, *table, *scan, *self._place, best, log_mass)
        mass = np.exp(log_mass.astype(np.float64) - float(log_mass.max())) * known
        evidence = float(log_mass.max()) + math.log(mass.sum() / HEADINGS)
        draws = np.empty(len(rows), np.int64)
        exhaustive.split_draws(mass / mass.sum(), uniforms(key, 1)[0], n, draws)
        drawn = np.flatnonzero(draws)
        first = np.concatenate([[0], np.cumsum(draws[drawn])])
        cell, heading = np.empty(n, np.int32), np.empty(n, np.int32)
        turns = key + np.uint64(2)
        exhaustive.draw_headings(
            len(drawn) * work, rows[drawn], first, *table, *scan, *self._place, cell, heading, turns
        )
        return Posterior(self._poses(cell, heading, key), self._table.cells[rows], best * np.float32(temper), evidence)

    def _poses(self, cell: NDArray[np.int32], heading: NDArray[np.int32], key: np.uint64) -> NDArray[np.float32]:
        """(3, n) poses of the robot, anywhere within the laser's cell and heading: the table tells none apart."""
        jitter = uniforms(key + np.uint64(1), 3 * len(cell)).reshape(3, -1)
        x = (cell % self._grid.width + jitter[0]) * self._grid.resolution
        y = (cell // self._grid.width + jitter[1]) * self._grid.resolution
        yaw = (heading - self._expected.first + jitter[2] - 0.5) * BIN
        poses = compose(np.stack([x, y, yaw], axis=-1), inverse(self._laser.pose))
        return np.ascontiguousarray(poses.T.astype(np.float32))
