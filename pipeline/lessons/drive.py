"""A piece of the embedded drive, as the small filter takes it: scans, odometry, truth, and the map in plain arrays."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pipeline.lessons.exam import Array
from pipeline.maps.occupancy_grid import OccupancyGrid

LONGEST = 15.0
"""m: what the laser reads from farther off counts as if nothing had come back."""
WALL, FLOOR = 0.9, 0.2
"""Occupied with at least this probability; free with less."""
NEAREST = 0.05
"""m: how near a ray must come to a wall, on its way, to have met it."""


@dataclass(frozen=True)
class Drive:
    """n scans of the embedded drive. Poses are x, y (m), yaw (rad) in the grid's frame.

    ``times`` (n,) s since the log's first scan, ``scans`` (n,) their indices; ``odometry`` and ``truth`` (n, 3);
    ``ranges`` (n, k) m, ``angles`` (k,) rad in the laser's frame; ``laser`` (3,) its pose on the robot;
    ``occupied`` and ``free`` (rows, columns) bool, ``distances`` (rows, columns) m to the nearest occupied cell;
    ``grid`` the map.
    """

    scans: NDArray[np.int64]
    times: Array
    odometry: Array
    truth: Array
    ranges: Array
    angles: Array
    laser: Array
    occupied: NDArray[np.bool_]
    free: NDArray[np.bool_]
    distances: Array
    grid: OccupancyGrid

    def __len__(self) -> int:
        return len(self.times)

    def part(self, scans: slice | NDArray[np.int64], beams: int) -> Drive:
        """Some of the scans, with so many beams of each, evenly spread."""
        chosen = np.linspace(0, len(self.angles) - 1, beams).round().astype(int)
        return replace(
            self,
            scans=self.scans[scans],
            times=self.times[scans],
            odometry=self.odometry[scans],
            truth=self.truth[scans],
            ranges=self.ranges[scans][:, chosen],
            angles=self.angles[chosen],
        )

    def expected(self, poses: Array) -> Array:
        """(n, k) true ranges of the beams at poses (n, 3): along each ray, as far at a time as no wall is near."""
        yaw = poses[:, 2, None]
        x = poses[:, 0, None] + self.laser[0] * np.cos(yaw) - self.laser[1] * np.sin(yaw)
        y = poses[:, 1, None] + self.laser[0] * np.sin(yaw) + self.laser[1] * np.cos(yaw)
        cos, sin = np.cos(yaw + self.laser[2] + self.angles), np.sin(yaw + self.laser[2] + self.angles)
        ranges = np.zeros(cos.shape)
        rows, columns = self.occupied.shape
        for _ in range(60):
            row = np.floor((y + ranges * sin) / self.grid.resolution).astype(int)
            column = np.floor((x + ranges * cos) / self.grid.resolution).astype(int)
            inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
            free = self.distances[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
            ranges = np.where(inside, ranges + np.where(free > NEAREST, 0.9 * free, 0.0), LONGEST)
            if ranges.min() >= LONGEST:
                break
        return np.minimum(ranges, LONGEST)


@cache
def embedded_drive() -> Drive:
    """The whole of the embedded drive."""
    from scipy import ndimage

    from converters import read_map
    from converters.cached import read
    from pipeline.evaluate.metrics import interpolate
    from pipeline.logs.tum import read_tum
    from pipeline.simulate import sample_dir

    sample = sample_dir()
    grid = read_map(sample / "office.dat.gz")
    log = read(sample / "office.log.gz", grid).log
    occupied = grid.occupied(WALL)
    ranges = np.where(np.isfinite(log.ranges), log.ranges, LONGEST).astype(np.float64)
    return Drive(
        scans=np.arange(len(log)),
        times=log.times,
        odometry=log.odometry,
        truth=grid.to_grid(interpolate(read_tum(sample / "office_truth.tum"), log.stamps)),
        ranges=np.minimum(ranges, LONGEST),
        angles=log.laser.angles,
        laser=np.array(log.laser.pose),
        occupied=occupied,
        free=grid.free(FLOOR),
        distances=ndimage.distance_transform_edt(~occupied) * grid.resolution,
        grid=grid,
    )
