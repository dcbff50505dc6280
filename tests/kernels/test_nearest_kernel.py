"""The nearest cell of a kind, against all of them tried."""

from __future__ import annotations

import numpy as np
import pytest
import reference

from pipeline.kernels.nearest import FAR, nearest


@pytest.mark.parametrize("reach", [0, 1, 4, 50])
@pytest.mark.parametrize("seed", range(3))
def test_nearest_agrees_with_its_twin(seed: int, reach: int) -> None:
    wanted = np.random.default_rng(seed).random((19, 27)) < 0.04
    squared, at = np.empty(wanted.shape, np.int32), np.empty(wanted.shape, np.int32)
    nearest(wanted, reach, squared, at)
    expected = reference.nearest_squared(wanted)
    near = expected <= reach**2
    np.testing.assert_array_equal(squared[near], expected[near])
    assert (squared[~near] > reach**2).all()
    row, col = np.indices(wanted.shape)
    found = at >= 0
    assert (found == (squared < FAR)).all()
    assert wanted.reshape(-1)[at[found]].all()
    there = np.divmod(at[found], wanted.shape[1])
    np.testing.assert_array_equal((there[0] - row[found]) ** 2 + (there[1] - col[found]) ** 2, squared[found])
