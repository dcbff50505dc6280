"""The field of distances against every pair of cells, and what counts as an obstacle."""

from __future__ import annotations

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pipeline.errors import MclError
from pipeline.maps.distance_field import build_distance_field
from pipeline.maps.occupancy_grid import OccupancyGrid

RESOLUTION = 0.1
probabilities = st.sampled_from([0.0, 0.3, 0.65, 1.0, np.nan]).map(np.float32)


@given(arrays(np.float32, st.tuples(st.integers(1, 9), st.integers(1, 9)), elements=probabilities),
       st.floats(0.05, 1.5))  # fmt: skip
@settings(deadline=None, max_examples=60)
def test_distances_are_those_to_the_nearest_obstacle(occupancy: np.ndarray, max_dist: float) -> None:
    field = build_distance_field(OccupancyGrid(occupancy, RESOLUTION), 0.65, max_dist)
    expected = reference.nearest_obstacle(occupancy >= np.float32(0.65), RESOLUTION, max_dist)
    np.testing.assert_allclose(field.distances[field.codes], expected, atol=1e-12)
    assert (np.diff(field.distances) > 0).all()
    assert field.distances[-1] == max_dist


def test_unknown_cells_are_no_obstacles() -> None:
    occupancy = np.full((5, 9), np.nan, np.float32)
    occupancy[2, 0] = 1.0
    field = build_distance_field(OccupancyGrid(occupancy, RESOLUTION), 0.65, 0.5)
    assert field.distances[field.codes[2]] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.5, 0.5])


def test_without_an_obstacle_everything_is_far() -> None:
    field = build_distance_field(OccupancyGrid(np.zeros((4, 4), np.float32), RESOLUTION), 0.65, 2.0)
    assert field.distances.tolist() == [2.0]
    assert not field.codes.any()


def test_too_many_distances_to_tell_apart() -> None:
    occupancy = np.zeros((1000, 1000), np.float32)
    occupancy[0, 0] = 1.0
    with pytest.raises(MclError, match="lower laser_likelihood_max_dist"):
        build_distance_field(OccupancyGrid(occupancy, RESOLUTION), 0.65, 200.0)
