"""Where the particles start."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.geometry import wrap_angle
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.parts.loading import built_in
from pipeline.parts.roles import ROLES


def initial_particles(grid: OccupancyGrid, config: Config, key: int) -> NDArray[np.float32]:
    """(3, max_particles) float32 poses in the grid frame, drawn as ``config.init`` says.

    Raises MclError if the map has no free cell, or initial_pose is not on the map.
    """
    # Philox counts, as our own kernels do: the draw depends on the key alone.
    rng = np.random.Generator(np.random.Philox(key=key))
    n, own = config.max_particles, config.own_part("init", grid=grid)
    if own is not None:
        placed = own.poses(own(n, rng=rng), (3, n)).T
        return np.ascontiguousarray(grid.to_grid(placed).T.astype(np.float32))
    draw = built_in(ROLES["init"], config.init)
    poses: NDArray[np.float32] = draw(n, rng, grid, config)
    return poses


def over_free_space(n: int, rng: np.random.Generator, grid: OccupancyGrid, config: Config) -> NDArray[np.float32]:
    """Uniform over the free cells and all headings (the report's init_particles_freespace)."""
    rows, cols = np.nonzero(grid.free(config.free_threshold))
    if len(rows) == 0:
        raise MclError("the map has no free cell to start in", "raise free_threshold")
    cell = rng.integers(len(rows), size=n)
    at = rng.random((2, n))
    theta = rng.uniform(-np.pi, np.pi, n)
    return np.stack([(cols[cell] + at[0]) * grid.resolution, (rows[cell] + at[1]) * grid.resolution, theta]).astype(
        np.float32
    )


def over_map(n: int, rng: np.random.Generator, grid: OccupancyGrid, config: Config) -> NDArray[np.float32]:  # noqa: ARG001
    """Uniform over the map's rectangle and all headings."""
    size = np.array([grid.width, grid.height]) * grid.resolution
    xy = rng.random((2, n)) * size[:, None]
    return np.vstack([xy, rng.uniform(-np.pi, np.pi, n)]).astype(np.float32)


def around_pose(n: int, rng: np.random.Generator, grid: OccupancyGrid, config: Config) -> NDArray[np.float32]:
    """Gaussian around initial_pose with initial_pose_std, independent in x, y and yaw of the map frame."""
    mean = np.array(config.initial_pose, dtype=np.float64)
    x, y, _ = grid.to_grid(mean) / grid.resolution
    if not (0 <= x < grid.width and 0 <= y < grid.height):
        raise MclError(f"initial_pose {tuple(mean.tolist())} is not on the map", "give x, y in metres, yaw in radians")
    poses = grid.to_grid(mean + rng.standard_normal((n, 3)) * np.array(config.initial_pose_std))
    poses[:, 2] = wrap_angle(poses[:, 2])
    return np.ascontiguousarray(poses.T.astype(np.float32))
