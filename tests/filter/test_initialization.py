"""Where the particles start: over the free cells, over the map, around a pose."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.filter.initialization import initial_particles
from pipeline.maps.occupancy_grid import OccupancyGrid

N = 40_000


def grid(origin=(0.0, 0.0, 0.0)) -> OccupancyGrid:
    """6 x 8 cells of half a metre: free, not so free, walls, unknown."""
    cells = np.full((6, 8), 0.05, np.float32)
    cells[0] = 1.0
    cells[:, 7] = np.nan
    cells[3, 2:5] = 0.5
    return OccupancyGrid(cells, 0.5, origin)


def config(**values) -> Config:
    return Config(max_particles=N, **values)


def test_free_space_is_filled_evenly() -> None:
    poses = initial_particles(grid(), config(init="free_space"), 7)
    assert poses.shape == (3, N)
    assert poses.dtype == np.float32
    col, row = np.floor(poses[:2] / 0.5).astype(int)
    free = grid().free(0.25)
    assert free[row, col].all()
    counts = np.bincount(row * 8 + col, minlength=48)[free.reshape(-1)]
    assert stats.chisquare(counts).pvalue > 1e-3
    for within in (poses[0] % 0.5 / 0.5, poses[1] % 0.5 / 0.5, (poses[2] + np.pi) / (2 * np.pi)):
        assert stats.kstest(within, "uniform").pvalue > 1e-3


def test_the_whole_map_is_filled_evenly() -> None:
    x, y, theta = initial_particles(grid(), config(init="map"), 7)
    for share in (x / 4.0, y / 3.0, (theta + np.pi) / (2 * np.pi)):
        assert stats.kstest(share, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (10.0, -20.0, 1.0)])
def test_around_a_pose_of_the_map_frame(origin) -> None:
    g = grid(origin)
    mean = g.to_map([2.0, 1.5, 3.1])
    std = 0.3, 0.1, 0.2
    poses = initial_particles(g, config(init="pose", initial_pose=tuple(mean.tolist()), initial_pose_std=std), 7)
    assert np.abs(poses[2]).max() <= np.float32(np.pi)
    off = g.to_map(poses.T) - mean
    off[:, 2] = np.mod(off[:, 2] + np.pi, 2 * np.pi) - np.pi
    assert (np.abs(off.mean(axis=0)) < 5 * np.array(std) / math.sqrt(N)).all()
    np.testing.assert_allclose(off.std(axis=0), std, rtol=0.02)
    assert np.abs(np.corrcoef(off.T) - np.eye(3)).max() < 0.03


def test_exactly_at_a_pose() -> None:
    poses = initial_particles(grid(), config(init="pose", initial_pose=(1.0, 2.0, 0.5), initial_pose_std=(0, 0, 0)), 7)
    np.testing.assert_allclose(poses.T, [[1.0, 2.0, 0.5]] * N, atol=1e-6)


@pytest.mark.parametrize("init", ["free_space", "map"])
def test_the_key_decides(init: str) -> None:
    first = initial_particles(grid(), config(init=init), 7)
    np.testing.assert_array_equal(first, initial_particles(grid(), config(init=init), 7))
    assert not np.array_equal(first, initial_particles(grid(), config(init=init), 8))
    assert np.abs(np.corrcoef(first[0], initial_particles(grid(), config(init=init), 8)[0])[0, 1]) < 0.03


def test_the_origin_of_the_map_does_not_matter() -> None:
    np.testing.assert_array_equal(
        initial_particles(grid(), config(init="free_space"), 7),
        initial_particles(grid((5.0, 6.0, 2.0)), config(init="free_space"), 7),
    )


def test_no_free_cell() -> None:
    with pytest.raises(MclError, match=r"no free cell.*free_threshold"):
        initial_particles(grid(), config(init="free_space", free_threshold=0.01), 7)


@pytest.mark.parametrize("pose", [(-0.1, 1.0, 0.0), (1.0, 3.1, 0.0), (1e6, 0.0, 0.0)])
def test_a_pose_off_the_map(pose) -> None:
    with pytest.raises(MclError, match="not on the map"):
        initial_particles(grid(), config(init="pose", initial_pose=pose), 7)
