"""The map: what its cells say at a threshold, its frames, its identity."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.maps.occupancy_grid import OccupancyGrid

CELLS = np.array([[0.0, 0.25, 0.3], [0.65, 1.0, np.nan]], np.float32)
coordinates = st.floats(-100, 100)
poses = st.tuples(coordinates, coordinates, st.floats(-3.14, 3.14))


def test_size() -> None:
    grid = OccupancyGrid(CELLS, 0.1)
    assert (grid.height, grid.width) == (2, 3)
    assert grid.origin == (0.0, 0.0, 0.0)


def test_thresholds() -> None:
    """Occupied from the threshold on, free below it; a cell may be neither, an unknown one always is."""
    grid = OccupancyGrid(CELLS, 0.1)
    assert grid.occupied(0.65).tolist() == [[False, False, False], [True, True, False]]
    assert grid.free(0.25).tolist() == [[True, False, False], [False, False, False]]
    assert grid.known.tolist() == [[True, True, True], [True, True, False]]
    assert not (grid.free(0.25) & grid.occupied(0.65)).any()
    assert grid.occupied(0.0).sum() == 5
    assert grid.free(1.0).sum() == 4


@pytest.mark.parametrize("value", [0.1, 0.65, 0.7, 0.97])
def test_a_threshold_and_a_cell_of_the_same_value(value: float) -> None:
    """Cells are single precision and thresholds double: 0.65 must count as at least 0.65."""
    grid = OccupancyGrid(np.array([[value]], np.float32), 0.1)
    assert grid.occupied(value).all()
    assert not grid.free(value).any()


@given(poses, poses)
def test_frames_are_each_others_inverse(origin, pose) -> None:
    grid = OccupancyGrid(CELLS, 0.1, origin)
    for back in (grid.to_map(grid.to_grid(pose)), grid.to_grid(grid.to_map(pose))):
        np.testing.assert_allclose(back[:2], pose[:2], atol=1e-9)
        assert math.cos(back[2] - pose[2]) == pytest.approx(1.0)


def test_the_grid_frame() -> None:
    """Its origin is the corner of cell (0, 0), its x axis runs along the rows."""
    grid = OccupancyGrid(CELLS, 0.1, (10.0, 20.0, math.pi / 2))
    np.testing.assert_allclose(grid.to_map([0.0, 0.0, 0.0]), [10, 20, math.pi / 2])
    np.testing.assert_allclose(grid.to_map([0.3, 0.0, 0.5]), [10, 20.3, math.pi / 2 + 0.5])
    found = grid.to_grid([[10, 20.3, math.pi / 2], [9.8, 20, math.pi]])
    np.testing.assert_allclose(found, [[0.3, 0, 0], [0, 0.2, math.pi / 2]], atol=1e-12)


def test_identity() -> None:
    same = OccupancyGrid(CELLS.copy(), 0.1)
    assert OccupancyGrid(CELLS, 0.1).sha256 == same.sha256
    changed = CELLS.copy()
    changed[0, 0] = 0.01
    others = [
        OccupancyGrid(changed, 0.1),
        OccupancyGrid(CELLS, 0.1, (0.0, 0.0, 1e-9)),
        OccupancyGrid(CELLS, 0.05),
        OccupancyGrid(CELLS.T.copy(), 0.1),
        OccupancyGrid(CELLS.reshape(3, 2), 0.1),
    ]
    assert len({same.sha256, *(other.sha256 for other in others)}) == 6


def test_identity_does_not_depend_on_the_layout_in_memory() -> None:
    assert OccupancyGrid(np.asfortranarray(CELLS), 0.1).sha256 == OccupancyGrid(CELLS, 0.1).sha256


def test_identity_does_not_depend_on_the_kind_of_number() -> None:
    plain = OccupancyGrid(CELLS, 0.1, (1.5, -2.0, 0.25))
    assert OccupancyGrid(CELLS, np.float64(0.1), (np.float64(1.5), -2, np.float32(0.25))).sha256 == plain.sha256
    assert OccupancyGrid(CELLS, 0.1, np.array([1.5, -2.0, 0.25])).sha256 == plain.sha256


@pytest.mark.parametrize(
    ("wall", "beside", "threshold"),
    [(1.0, 0.0, 0.97), (0.99, 0.98, 0.97), (0.8, 0.0, 0.65), (0.99, 0.7, 0.65)],
    ids=["two colours", "saturated", "grey", "smeared by a cell"],
)
def test_a_map_of_grey_walls_stops_rays_at_a_lower_probability(wall: float, beside: float, threshold: float) -> None:
    occupancy = np.full((20, 20), 0.02, np.float32)
    occupancy[:, 10], occupancy[:, 9], occupancy[:, 11] = wall, max(beside, 0.02), max(beside, 0.02)
    grid = OccupancyGrid(occupancy, 0.05)
    assert grid.wall_threshold(None) == threshold
    assert grid.wall_threshold(0.4) == 0.4


def test_a_map_without_walls_has_a_threshold_all_the_same() -> None:
    assert OccupancyGrid(np.zeros((5, 5), np.float32), 0.1).wall_threshold(None) == 0.97
