"""Where the particles start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.geometry import wrap_angle
from pipeline.maps.occupancy_grid import OccupancyGrid


def initial_particles(grid: OccupancyGrid, config: Config, key: int) -> NDArray[np.float32]:
    """(3, max_particles) float32 poses in the grid frame, drawn as ``config.init`` says.

    Raises MclError if the map has no free cell, or initial_pose is not on the map.
    """
    # Philox counts, as our own kernels do: the draw depends on the key alone.
    rng = np.random.Generator(np.random.Philox(key=key))
    n = config.max_particles
    if config.init == "pose":
        return _around_pose(grid, config, rng, n)
    if config.init == "map":
        return _over_map(grid, rng, n)
    return _over_free_space(grid, config.free_threshold, rng, n)


def _over_free_space(grid: OccupancyGrid, threshold: float, rng: np.random.Generator, n: int) -> NDArray[np.float32]:
    """Uniform over the free cells and all headings (the report's init_particles_freespace)."""
    rows, cols = np.nonzero(grid.free(threshold))
    if len(rows) == 0:
        raise MclError("the map has no free cell to start in", "raise free_threshold")
    cell = rng.integers(len(rows), size=n)
    at = rng.random((2, n))
    theta = rng.uniform(-np.pi, np.pi, n)
    return np.stack([(cols[cell] + at[0]) * grid.resolution, (rows[cell] + at[1]) * grid.resolution, theta]).astype(
        np.float32
    )


def _over_map(grid: OccupancyGrid, rng: np.random.Generator, n: int) -> NDArray[np.float32]:
    """Uniform over the map's rectangle and all headings."""
    size = np.array([grid.width, grid.height]) * grid.resolution
    xy = rng.random((2, n)) * size[:, None]
    return np.vstack([xy, rng.uniform(-np.pi, np.pi, n)]).astype(np.float32)


def _around_pose(grid: OccupancyGrid, config: Config, rng: np.random.Generator, n: int) -> NDArray[np.float32]:
    """Gaussian around initial_pose with initial_pose_std, independent in x, y and yaw of the map frame."""
    mean = np.array(config.initial_pose, dtype=np.float64)
    x, y, _ = grid.to_grid(mean) / grid.resolution
    if not (0 <= x < grid.width and 0 <= y < grid.height):
        raise MclError(f"initial_pose {tuple(mean.tolist())} is not on the map", "give x, y in metres, yaw in radians")
    poses = grid.to_grid(mean + rng.standard_normal((n, 3)) * np.array(config.initial_pose_std))
    poses[:, 2] = wrap_angle(poses[:, 2])
    return np.ascontiguousarray(poses.T.astype(np.float32))
